"""One file a format: reading and writing what people bring."""
