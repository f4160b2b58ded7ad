"""Runs a pass over recordings here, or over an existing Dask cluster: the same numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol, TypeVar

from hydro_ident.errors import IdentError

T = TypeVar("T")
R = TypeVar("R")


class Workers(Protocol):
    """Applies a function to recordings and returns the results in their order."""

    def map(self, work: Callable[[T], R], items: Sequence[T]) -> list[R]:
        """Results in the order of the items.

        `work` is the function.
        """
        ...


class Here:
    """This process, one recording after the other."""

    def map(self, work: Callable[[T], R], items: Sequence[T]) -> list[R]:
        """Results in the order of the items.

        `work` is the function.
        """
        return [work(item) for item in items]


class DaskWorkers:
    """The workers of a Dask cluster; a recording is read by one of them.

    Each result is a function of one recording alone and results are combined here in the
    recordings' order, so that neither the number of workers nor their speed shows in the answer.
    The workers need this package and see the bags under the same paths.

    Parameters
    ----------
    address : str
        Of the scheduler, such as `tcp://host:8786`.

    Raises
    ------
    IdentError
        `distributed` is not installed, or nothing answers at the address.
    """

    def __init__(self, address: str) -> None:
        try:
            import distributed
        except ImportError as error:
            raise IdentError(
                "--scheduler needs the package 'distributed' (pip install distributed), which is"
                " not installed"
            ) from error
        try:
            client: Any = distributed.Client
            self._client: Any = client(address, timeout="10s", set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            why = " ".join(str(error).split())
            raise IdentError(f"no Dask scheduler at '{address}': {why}") from error

    def map(self, work: Callable[[T], R], items: Sequence[T]) -> list[R]:
        """Results in the order of the items; an error on a worker is raised here.

        `work` is the function.
        """
        futures = self._client.map(work, items, pure=False)
        return list(self._client.gather(futures))

    def close(self) -> None:
        """Leave the cluster as it was."""
        self._client.close()


@contextmanager
def workers_at(address: str | None) -> Iterator[Workers]:
    """The workers of a cluster, or this process where there is no address."""
    if address is None:
        yield Here()
        return
    workers = DaskWorkers(address)
    try:
        yield workers
    finally:
        workers.close()
