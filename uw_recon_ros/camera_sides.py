"""Which of two names is the left camera's: the one table of words, for topics, folders and files alike."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

#: Words for the left (upper) and the right (lower) camera, best known first.
PAIRS = (
    ("left", "right"), ("port", "starboard"), ("port", "stbd"), ("upper", "lower"), ("top", "bottom"), ("l", "r"),
    ("master", "slave"), ("primary", "secondary"), ("links", "rechts"), ("gauche", "droite"),
    ("izquierda", "derecha"), ("izquierdo", "derecho"), ("izq", "der"), ("sinistra", "destra"), ("esquerda", "direita"),
    ("babord", "tribord"), ("bâbord", "tribord"), ("babor", "estribor"), ("backbord", "steuerbord"),
    ("bakboord", "stuurboord"), ("babord", "styrbord"), ("bombordo", "estibordo"),
)  # fmt: skip
_WHOLE = {"l", "r", "izq", "der"}  # words that others contain
NUMBERED = len(PAIRS)  #: grade of names that differ by a number only
_LETTERED = NUMBERED + 2  #: of names that differ by a letter: of three cameras nobody knows which two are the rig
_WORD_AND_NUMBER = NUMBERED + 3  # of names whose side and serial number differ
#: A camera's number: behind a word that means one, or alone between slashes.
_NUMBER = re.compile(
    r"(?:cam|camera|image|images|img|infra|ir|fisheye|slave|sensor|eye|view|cam[a-z]*|(?:^|/)(?=[0-9]{1,2}(?:/|$)))[_-]?([0-9]{1,2})(?![0-9])",
    re.IGNORECASE,
)
_LETTER = re.compile(r"(?:cam|camera|view|sensor)[_-]?([a-g])(?![a-z0-9])", re.IGNORECASE)
_DIGITS = re.compile(r"[0-9]+")
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+")


def partners(left: str) -> dict[str, int]:
    """What the right camera may be called for a name of the left one: lower-case names and their grades, 0 the best."""
    found: dict[str, int] = {}
    for grade, (word, other) in enumerate(PAIRS):
        places = list(_places(left, word))
        for chosen in [places, *([place] for place in places if len(places) > 1)]:
            if chosen:
                found.setdefault(_replaced(left, chosen, len(word), other), grade)
    for match in _NUMBER.finditer(left):
        number = int(match[1])
        following = str(number + 1).zfill(len(match[1]))
        name = f"{left[: match.start(1)]}{following}{left[match.end(1) :]}".lower()
        found.setdefault(name, NUMBERED + min(number, 2))
    for match in _LETTER.finditer(left):
        following = chr(ord(match[1].lower()) + 1)
        found.setdefault(f"{left[: match.start(1)]}{following}{left[match.end(1) :]}".lower(), _LETTERED)
    return found


def _places(name: str, word: str) -> Iterator[int]:
    """Where a word begins: a long one anywhere, a short one only as a word of its own."""
    if word not in _WHOLE:
        yield from (match.start() for match in re.finditer(word, name.lower()))
    else:
        yield from (match.start() for match in _WORD.finditer(name) if match[0].lower() == word)


def _replaced(name: str, places: Sequence[int], length: int, other: str) -> str:
    pieces, done = [], 0
    for place in places:
        pieces += [name[done:place], other]
        done = place + length
    return "".join([*pieces, name[done:]]).lower()


def pairs_of(names: Sequence[str]) -> list[tuple[int, str, str]]:
    """Grade, left and right of every two names that can be a rig's, best first."""
    known = {name.lower(): name for name in names}
    found = [
        (grade, left, known[right])
        for left in names
        for right, grade in partners(left).items()
        if right in known and known[right] != left
    ]
    return sorted(found or _but_for_numbers(names))


def _but_for_numbers(names: Sequence[str]) -> Iterator[tuple[int, str, str]]:
    """Names that tell the side and differ in a number too, as of cameras called by their serial numbers."""
    shapes = {name: _DIGITS.sub("#", name.lower()) for name in names}
    for left in names:
        for other, grade in partners(_DIGITS.sub("#", left)).items():
            alike = [name for name in names if shapes[name] == other and name != left]
            if grade < NUMBERED and len(alike) == 1:
                yield _WORD_AND_NUMBER, left, alike[0]


def side_of(name: str) -> int | None:
    """0: a name of the left camera, 1: of the right; None: it does not tell, or tells both."""
    told = {side for pair in PAIRS for side, word in enumerate(pair) if list(_places(name, word))}
    told = told or ({int(name[-1])} if name[-1:] in ("0", "1") else set())
    return told.pop() if len(told) == 1 else None
