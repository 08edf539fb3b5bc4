"""A notebook shows the text of a result, and no name in it becomes HTML."""

from pamjax.notebook import NotebookText


class Result(NotebookText):
    def __str__(self):
        return "<b>first</b> line\nsecond line"


def test_html_is_the_escaped_text():
    assert Result()._repr_html_() == "<pre>&lt;b&gt;first&lt;/b&gt; line\nsecond line</pre>"


def test_repr_is_the_first_line():
    assert repr(Result()) == "<Result: <b>first</b> line>"
