"""One root for every error that is the user's to mend."""


class HexsimError(Exception):
    """A problem with what the user gave: one sentence that says what, where, what is allowed and what to do.

    The command line prints the sentence and ends with exit code 2; no traceback.
    """
