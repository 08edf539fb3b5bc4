"""Parser of HTML pages for tests: elements, tables and text."""

from html.parser import HTMLParser

VOID = {"meta", "br", "hr", "img", "link", "input", "wbr"}


class Page(HTMLParser):
    """Elements, tables and text of a page; unbalanced tags raise an error."""

    def __init__(self, text):
        super().__init__()
        self.open, self.elements, self.tables, self.entries = [], [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append([])
        if tag in ("td", "th"):
            self.tables[-1][-1].append("")

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ("td", "th"):
            self.tables[-1][-1][-1] += data
        if "svg" not in self.open and "style" not in self.open:
            self.entries.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.entries).split())

    def every(self, tag):
        return [attrs for name, attrs in self.elements if name == tag]

    def list_active_parts(self):
        """Return the scripts, the handlers of events, and the elements that load something."""
        scripts = [tag for tag, _ in self.elements if tag in ("script", "iframe", "object", "embed")]
        attributes = [(tag, *pair) for tag, attrs in self.elements for pair in attrs.items()]
        handlers = [name for _, name, _ in attributes if name.startswith("on")]
        loads = [str(value)[:12] for _, name, value in attributes if name in ("src", "srcdoc", "action")]
        links = [value for _, name, value in attributes if name == "href" and ":" in str(value)]
        return scripts + handlers + loads + links

    def table(self, first):
        """Return the rows, by first cell, of the only table whose header starts with `first`."""
        (table,) = (rows for rows in self.tables if rows[0][:2] == first)
        return {row[0]: row[1:] for row in table[1:]}
