"""Options of commands and sources, declared once as fields of dataclasses: type, default, and help."""

from __future__ import annotations

import dataclasses
from typing import Any


def option(text: str, form: str = "", default: Any = None, **more: Any) -> Any:
    """Return the field of an option.

    Parameters
    ----------
    text : str
        Its help; what its default is, is added.
    form : str
        What stands for its value there; words for several values.
    default : object
        Its value if it is not given; ``MISSING``: it is required.
    more
        ``group``, the title of its group, and words about that after a colon; ``either``, the name of those
        of which one may be given; ``names`` in place of its field's; ``positional``; ``const``, its value if
        it is given without one; ``read``, which reads its text; ``choices``, which returns them; ``parts``,
        which returns dataclasses whose options it has.
    """
    return dataclasses.field(default=default, metadata={"text": text, "form": form, **more})
