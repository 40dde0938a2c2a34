"""Tables of scores in text, Markdown, LaTeX and CSV."""
