"""One evaluation as one self-contained HTML page: tables, figures, pictures, configuration; nothing else is loaded."""
