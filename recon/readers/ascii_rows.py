"""Rows of an ESRI ASCII grid that is too large to be held as text: where each begins, and those that are asked for.

ncols 12000 ...        header, one entry a line
812.4 812.9 813.1 ...  row 0, the northernmost: one line a row, as every program writes it
811.9 812.2 812.8 ...  row 1
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["AsciiRows"]

Floats = NDArray[np.float64]

BAND = 64  # rows that are read at once
HELD = 2**28  # bytes of rows that are kept for the next window


class AsciiRows:
    """Rows from the north, as many as the header says.

    header  its entries, named in small letters

    Raises  KeyError where the header lacks an entry, ValueError where the rows are not one a line; from `rows`
            ValueError where one has not as many heights as there are columns, or a word that is no number.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.header, self._starts = _looked_through(path)
        n_rows = int(self.header["nrows"])
        if len(self._starts) != n_rows + 1:
            raise ValueError(f"its {n_rows} rows are not one a line")
        self._columns = int(self.header["ncols"])
        self._most = max(2, HELD // (8 * BAND * max(self._columns, 1)))
        self._bands: dict[int, Floats] = {}

    def rows(self, first: int, stop: int) -> Floats:
        """(stop - first, columns) heights as they are written."""
        bands = [self._band(k) for k in range(first // BAND, -(-stop // BAND))]
        skipped = first // BAND * BAND
        together = np.concatenate([np.empty((0, self._columns)), *bands])
        return np.asarray(together[first - skipped : stop - skipped])

    def _band(self, number: int) -> Floats:
        found = self._bands.pop(number, None)
        if found is None:
            found = self._parsed(range(number * BAND, min((number + 1) * BAND, len(self._starts) - 1)))
        self._bands[number] = found  # the last one used stands last
        while len(self._bands) > self._most:
            del self._bands[next(iter(self._bands))]
        return found

    def _parsed(self, rows: range) -> Floats:
        found = np.empty((len(rows), self._columns))
        with self._path.open("rb") as stream:
            for k, row in enumerate(rows):
                stream.seek(self._starts[row])
                words = stream.read(self._starts[row + 1] - self._starts[row]).split()
                if len(words) != self._columns:
                    raise ValueError(f"row {row + 1} has {len(words)} heights, not {self._columns}")
                try:
                    found[k] = np.array(words, dtype=np.float64)
                except ValueError as problem:
                    raise ValueError(f"row {row + 1}: {problem}") from problem
        return found


def _looked_through(path: Path) -> tuple[dict[str, float], list[int]]:
    """Entries of the header; where lines begin that hold heights, and where the last one ends."""
    header: dict[str, float] = {}
    starts: list[int] = []
    at = 0
    with path.open("rb") as stream:
        for line in stream:
            words = line.split(maxsplit=2)
            if not starts and len(words) == 2 and words[0][:1].isalpha():
                header[words[0].decode().lower()] = float(words[1])
            elif words:
                starts.append(at)
            at += len(line)
    return header, [*starts, at]
