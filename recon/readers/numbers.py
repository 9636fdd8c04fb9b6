"""Words of a text file as numbers, with the first word that is none named in the error."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from recon.errors import BadGeometry, UnreadableFile

__all__ = ["number_array", "integers", "lines_with_words", "typed_numbers"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def number_array(words: Iterable[bytes], name: str) -> Floats:
    """(n,) the words as numbers; raises UnreadableFile with the first word that is none."""
    words = list(words)
    try:
        return np.array(list(map(float, words)), dtype=np.float64)
    except ValueError:
        word = next(word for word in words if not _is_number(word))
        shown = word[:24].decode("ascii", "replace")
        raise UnreadableFile(
            name, f"holds {shown!r} where a number belongs", "The file is damaged; export it again"
        ) from None


def typed_numbers(words: Iterable[bytes], kind: str, name: str) -> NDArray[np.generic]:
    """(n,) the words as numbers of a type; raises UnreadableFile with the first that the type does not hold."""
    numbers = number_array(words, name)
    with np.errstate(invalid="ignore", over="ignore"):
        typed = numbers.astype(kind)
    if typed.dtype.kind in "iu" and (typed.astype(np.float64) != numbers).any():
        odd = numbers[np.argmax(typed.astype(np.float64) != numbers)]
        raise UnreadableFile(name, f"holds {odd:g} where its type is {typed.dtype.name}", "Export it again")
    return typed


def integers(numbers: Floats, name: str) -> Ints:
    """(n,) numbers that stand for counts or places in a list; raises BadGeometry when one is no whole number."""
    whole = np.isfinite(numbers) & (np.abs(numbers) < 2.0**53) & (np.floor(numbers) == numbers)
    if not whole.all():
        raise BadGeometry(name, f"a face names point {numbers[np.argmin(whole)]}, which is not a whole number")
    return numbers.astype(np.int64)


def lines_with_words(data: bytes) -> list[list[bytes]]:
    """The words of every line that holds any, comments after # left out."""
    lines = (line.partition(b"#")[0].split() for line in data.splitlines())
    return [words for words in lines if words]


def _is_number(word: bytes) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
