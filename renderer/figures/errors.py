"""Error of all figures."""


class FigureError(ValueError):
    """Error for a figure that cannot be made from its input; the message says why."""
