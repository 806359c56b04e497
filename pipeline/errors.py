"""The one exception whose text is meant for the user, and how a text becomes one line."""


class InputError(Exception):
    """Something the user gave, or the machine refused, makes the job impossible.

    The text is one line: the file or variable, the value found, the value expected, what to do.
    The front door prints it after ``error:`` and ends with exit status 2, without a traceback.
    """


def one_line(text: str) -> str:
    """Return a text that may quote a stranger's as one line that a terminal prints and does not obey:
    whatever is not printable (line breaks, escape sequences, bytes that are no UTF-8) is written as its
    escape.
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text.strip())
