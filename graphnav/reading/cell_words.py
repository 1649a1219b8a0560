"""Cells as text: which are numbers, which are words for "no sample", which tell a time."""

import re
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# as pyarrow itself reads blanks: not told
PLAIN_BLANKS = ("", "nan", "NaN", "NAN", "null", "NULL", "NA", "N/A")
# Python, YAML and ROS, Excel and pandas, MATLAB, the C runtimes of Windows, R, Julia
OTHER_BLANKS = (
    "none", ".nan", "#n/a", "#na", "#n/a n/a", "n/a", "na", "null", "nil", "nan", "-nan", "+nan",
    "<na>", "nat", "-1.#ind", "1.#ind", "1.#qnan", "-1.#qnan", "-nan(ind)", "nan(ind)", "missing",
    "#value!", "#num!", "#div/0!", "-", "--", "---", "?", "*",
)  # fmt: skip
SPELT = sorted(
    {spelt for word in OTHER_BLANKS for spelt in (word, word.upper(), word.capitalize())}
    - set(PLAIN_BLANKS)
)
ENDLESS = re.compile(r"[+-]?\.?inf(inity)?|-?1\.#inf", re.IGNORECASE)
NUMBER = r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?"
# dates begin with a year in which there were recorders; a clock alone is a time of day
DATED = (
    r"(?:19|20)\d{2}[-/]?\d{2}[-/]?\d{2}[T ]\s*\d{2}:?\d{2}(:?\d{2}([.,]\d+)?)?"
    r"\s*(Z|UTC|[+-]\d{2}:?\d{2})?"
)
OF_DAY = r"\d{1,2}:\d{2}:\d{2}([.,]\d+)?"
_NUMBER, _TIME = re.compile(NUMBER), re.compile(f"{DATED}|{OF_DAY}")


def is_blank(word: str) -> bool:
    """Whether a cell says that there is no sample; an infinity is none."""
    word = word.strip()
    return word in PLAIN_BLANKS or word.lower() in OTHER_BLANKS or bool(ENDLESS.fullmatch(word))


def is_number(word: str) -> bool:
    """Whether a cell holds a number with a decimal point or none."""
    return bool(_NUMBER.fullmatch(word.strip()))


def is_time(word: str) -> bool:
    """Whether a cell holds an ISO 8601 time or a time of day."""
    return bool(_TIME.fullmatch(word.strip()))


def numbers_of(words: pa.Array, decimal: str = ".") -> tuple[Array, Mask, Mask]:
    """Cells as float64 (N,), NaN where there is none; which are an unusual word for blank (N,);
    which are neither number nor blank (N,).
    """
    words = pc.fill_null(trimmed(words), "")
    if decimal == ",":
        words = pc.replace_substring(words, ",", ".")
    plain, odd = (pc.is_in(words, value_set=pa.array(known)) for known in (PLAIN_BLANKS, SPELT))
    left = pc.if_else(pc.or_(plain, odd), pa.scalar(None, pa.string()), words)
    try:
        values = left.cast(pa.float64())
        if pc.all(pc.is_finite(values)).as_py() is not False:  # words for NaN are no numbers
            return _floats(values), _mask(odd), np.zeros(len(words), bool)
    except pa.ArrowInvalid:
        pass  # some are no numbers
    return _one_by_one(words, _mask(plain))


def _one_by_one(words: pa.Array, plain: Mask) -> tuple[Array, Mask, Mask]:
    """As `numbers_of`, of cells some of which are neither numbers nor one of the known words."""
    fits = pc.match_substring_regex(words, f"^{NUMBER}$")
    unsigned = pc.replace_substring_regex(words, r"^\+", "")
    numbers = _floats(pc.if_else(fits, unsigned, pa.scalar(None, pa.string())).cast(pa.float64()))
    number = _mask(fits)
    odd = np.zeros(len(number), bool)
    left = np.flatnonzero(~number & ~plain)
    if len(left):  # few distinct words, as a rule
        coded = pc.dictionary_encode(words.take(pa.array(left)))
        coded = coded.combine_chunks() if isinstance(coded, pa.ChunkedArray) else coded
        known = np.array([is_blank(word) for word in coded.dictionary.to_pylist()], bool)
        odd[left] = known[coded.indices.to_numpy(zero_copy_only=False)]
    endless = np.isinf(numbers)  # 1e999
    numbers[endless] = np.nan
    return numbers, odd | endless, ~number & ~plain & ~odd


def trimmed(words: pa.Array) -> pa.Array:
    """Without blanks around them; ASCII ones are quicker cut."""
    if pc.all(pc.string_is_ascii(words)).as_py():
        return pc.ascii_trim_whitespace(words)
    return pc.utf8_trim_whitespace(words)


def _floats(values: pa.Array) -> Array:
    return np.array(values.to_numpy(zero_copy_only=False), float)


def _mask(values: Any) -> Mask:
    return np.asarray(values.to_numpy(zero_copy_only=False), bool)
