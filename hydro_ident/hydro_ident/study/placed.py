"""Text that is made anew between two marks of a page of the documentation."""

from __future__ import annotations

from hydro_ident.errors import IdentError


def placed(page: str, content: str, begin: str, end: str) -> str:
    """A page with what stands between two marks replaced.

    Parameters
    ----------
    page : str
    content : str
        Without the marks.
    begin, end : str
        The marks; they stay.

    Returns
    -------
    str

    Raises
    ------
    IdentError
        The page lacks a mark.
    """
    before, found, rest = page.partition(begin)
    _, closed, after = rest.partition(end)
    if not found or not closed:
        raise IdentError(f"expected '{begin}' and '{end}' in the page, found neither")
    return f"{before}{begin}\n\n{content}\n{end}{after}"
