"""One file a subcommand of ``usvnet``; :mod:`usvnet.cli` gathers them."""
