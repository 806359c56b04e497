"""The one exception whose text is meant for the user."""


class InputError(Exception):
    """Something the user gave, or the machine refused, makes the job impossible.

    The text is one line: the file or variable, the value found, the value expected, what to do.
    The front door prints it after ``error:`` and ends with exit status 2, without a traceback.
    """
