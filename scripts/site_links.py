"""A hook of MkDocs: links between the pages and the repository that work on the site as they do in the repository.

Pages in ``docs/`` link to README.md, to sources and to configurations by relative paths, which a site made of ``docs/``
alone would break. A link to a module that the reference shows leads to its place there; any other file that is linked
becomes a page of the site, with its text in it. The README's own links are followed in the same way. Roles of
docstrings (``:func:`usvnet.heatmap.decode```) become links too.
"""

import posixpath
import re
from collections.abc import Iterator
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

SOURCES = "files"
"""Where the pages of files outside ``docs/`` are on the site."""
LINK = re.compile(r"(?<=\]\()(?P<path>[\w./-]+)(?P<anchor>#[\w.-]*)?(?=\))")
DIRECTIVE = re.compile(r"^::: ([\w.]+)", re.MULTILINE)
ROLE = re.compile(r":(?:attr|class|data|exc|func|meth|mod):<code>([\w.]+)</code>")
LANGUAGES = {".py": "python", ".yaml": "yaml", ".csv": "text", ".md": "markdown"}

origins: dict[str, str] = {}
"""By page of the site, the file of the repository that it shows, both as paths from their roots."""
modules: dict[str, str] = {}
"""By documented module, the page of the reference that shows it."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for every file outside ``docs/`` that a page links to, and for those that these link to in turn."""
    docs, root = Path(config.docs_dir), Path(config.docs_dir).parent
    origins.clear()
    modules.clear()
    texts = {}
    for file in files.documentation_pages():
        origins[file.src_uri] = f"{docs.name}/{file.src_uri}"
        texts[file.src_uri] = file.content_string
        modules.update(dict.fromkeys(DIRECTIVE.findall(file.content_string), file.src_uri))
    waiting = list(texts)
    while waiting:
        uri = waiting.pop()
        for target, _ in _links(uri, texts[uri], root):
            page = f"{SOURCES}/{_page_name(target)}"
            if target.startswith(f"{docs.name}/") or _module(target) in modules or page in origins:
                continue
            origins[page] = target
            texts[page] = _page_text(root / target)
            if target.endswith(".md"):
                waiting.append(page)
            files.append(File.generated(config, page, content=texts[page]))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn the repository's paths into those of the site."""
    uri, root = page.file.src_uri, Path(config.docs_dir).parent
    if uri.startswith(f"{SOURCES}/") and not origins[uri].endswith(".md"):
        return markdown
    moved = {link: _on_site(target, uri, root) for target, link in _links(uri, markdown, root)}
    return LINK.sub(lambda match: moved.get(match["path"], match["path"]) + (match["anchor"] or ""), markdown)


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn the roles of docstrings into links, where what they name is in the reference."""
    return ROLE.sub(r'<autoref identifier="\1" optional><code>\1</code></autoref>', html)


def _links(uri: str, text: str, root: Path) -> Iterator[tuple[str, str]]:
    """Every link to a file of the repository: the file, from the repository's root, and the link as it is written."""
    for match in LINK.finditer(text):
        target = posixpath.normpath(posixpath.join(posixpath.dirname(origins[uri]), match["path"]))
        if (root / target).is_file():
            yield target, match["path"]


def _on_site(target: str, uri: str, root: Path) -> str:
    """Where a file of the repository is, seen from a page of the site."""
    place = f"{SOURCES}/{_page_name(target)}"
    if target.startswith("docs/"):
        place = target.removeprefix("docs/")
    elif (module := _module(target)) in modules:
        return f"{posixpath.relpath(modules[module], posixpath.dirname(uri) or '.')}#{module}"
    return posixpath.relpath(place, posixpath.dirname(uri) or ".")


def _module(path: str) -> str:
    """``usvnet.geometry.lens`` of ``usvnet/geometry/lens.py``."""
    return path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def _page_name(path: str) -> str:
    return path if path.endswith(".md") else f"{path}.md"


def _page_text(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        return text
    return f"# {path.name}\n\n```{LANGUAGES.get(path.suffix, 'text')}\n{text}```\n"
