"""Meta commands of LDraw and its editors: lines that begin with 0, and what each of them is here.

Sources: LDraw.org's file format, multi-part documents and language extensions; the programs' own
documentation; LPub3D's ``meta.cpp`` and ``traverse.cpp``; LSynth's ``lsynth.mpd``. Of a
modification (``BUILD_MOD``), LPub3D's parts lists have the original, so we do too.
"""

import enum
import functools
from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple


class Meaning(enum.Enum):
    """Meanings that a meta command can have in a plan."""

    MODEL = "begins a model"
    NO_MODEL = "what follows, up to the next model, belongs to none"
    STEP = "ends a step"
    NOTE = "the note for this step in the booklet"
    OURS = "our comments, as above"
    STORE = "remembers what the model has so far"
    RETRIEVE = "the model has what it had at STORE, and nothing that was placed since"
    IGNORED = "what follows is no part of the model, up to the end of it"
    END_IGNORED = "the end of such lines"
    SUBSTITUTED = "what follows is one drawn piece, unless the catalogue knows a part of it"
    END_SUBSTITUTED = "the end of such a piece"
    SYNTH = (
        "what follows is one drawn piece; a chain of links, or an arc of bricks, is so many parts"
    )
    END_SYNTH = "the end of what LSynth draws"
    SYNTHESIZED = "the segments or links that LSynth has drawn"
    END_SYNTHESIZED = "the end of these"
    SHOW = "the parts that a band or hose runs around are parts of the model"
    HIDE = "the parts that a band or hose runs around are no parts of the model"
    DRAWN_MODEL = "this model is one drawn cable, hose, band or spring"
    GENERATOR = (
        "what lies between the MLCAD SKIP_BEGIN and SKIP_END that follow, or else this model, is "
        "one drawn hose, band or spring"
    )
    SHAPE = "this model is a part, or a shape in it, if it says so"
    HIDDEN = "no part of the model"
    GHOST = "a part of the plan's first model; of a sub-model it is no part"
    PICTURE = "nothing: it is for the pictures, pages and lists of that program; all parts stay"
    HEADER = "nothing: it says something about the file"


class MetaCommand(NamedTuple):
    """A kind of line.

    Attributes:
        words: after the 0; ``*`` is any word, and further words may follow.
        program: whose it is.
    """

    words: str
    program: str
    meaning: Meaning


META_COMMANDS = (
    MetaCommand("FILE", "LDraw", Meaning.MODEL),
    MetaCommand("NOFILE", "LDraw", Meaning.NO_MODEL),
    MetaCommand("STEP", "LDraw", Meaning.STEP),
    MetaCommand("ROTSTEP", "MLCad", Meaning.STEP),
    MetaCommand("//", "LDraw", Meaning.NOTE),
    MetaCommand("!BRICKSRL", "BricksRL", Meaning.OURS),
    MetaCommand("BUFEXCHG * STORE", "MLCad", Meaning.STORE),
    MetaCommand("BUFEXCHG * RETRIEVE", "MLCad", Meaning.RETRIEVE),
    MetaCommand("!LPUB PART BEGIN IGN", "LPub3D", Meaning.IGNORED),
    MetaCommand("!LPUB PART END", "LPub3D", Meaning.END_IGNORED),
    MetaCommand("LPUB PART BEGIN IGN", "LPub", Meaning.IGNORED),
    MetaCommand("LPUB PART END", "LPub", Meaning.END_IGNORED),
    MetaCommand("!LPUB BUILD_MOD BEGIN", "LPub3D", Meaning.IGNORED),
    MetaCommand("!LPUB BUILD_MOD END_MOD", "LPub3D", Meaning.END_IGNORED),
    MetaCommand("MLCAD SKIP_BEGIN", "MLCad", Meaning.IGNORED),
    MetaCommand("MLCAD SKIP_END", "MLCad", Meaning.END_IGNORED),
    MetaCommand("!LPUB PLI BEGIN SUB *", "LPub3D", Meaning.SUBSTITUTED),
    MetaCommand("!LPUB PLI END", "LPub3D", Meaning.END_SUBSTITUTED),
    MetaCommand("LPUB PLI BEGIN SUB *", "LPub", Meaning.SUBSTITUTED),
    MetaCommand("LPUB PLI END", "LPub", Meaning.END_SUBSTITUTED),
    MetaCommand("PLIST END", "LPub", Meaning.END_SUBSTITUTED),
    MetaCommand("SYNTH BEGIN *", "LSynth", Meaning.SYNTH),
    MetaCommand("SYNTH END", "LSynth", Meaning.END_SYNTH),
    MetaCommand("SYNTH SYNTHESIZED BEGIN", "LSynth", Meaning.SYNTHESIZED),
    MetaCommand("SYNTH SYNTHESIZED END", "LSynth", Meaning.END_SYNTHESIZED),
    MetaCommand("SYNTHESIZED BEGIN", "LSynth", Meaning.SYNTHESIZED),
    MetaCommand("SYNTHESIZED END", "LSynth", Meaning.END_SYNTHESIZED),
    MetaCommand("SYNTH SHOW", "LSynth", Meaning.SHOW),
    MetaCommand("SYNTH HIDE", "LSynth", Meaning.HIDE),
    MetaCommand("SYNTH", "LSynth", Meaning.PICTURE),
    MetaCommand("!LDCAD GENERATED", "LDCad", Meaning.DRAWN_MODEL),
    MetaCommand("MLCAD FLEXHOSE", "MLCad", Meaning.GENERATOR),
    MetaCommand("MLCAD RUBBER_BELT", "MLCad", Meaning.GENERATOR),
    MetaCommand("MLCAD SPRING", "MLCad", Meaning.GENERATOR),
    MetaCommand("!LDRAW_ORG *", "LDraw", Meaning.SHAPE),
    MetaCommand("MLCAD HIDE", "MLCad", Meaning.HIDDEN),
    MetaCommand("GHOST", "MLCad", Meaning.GHOST),
    MetaCommand("!LPUB PLI BEGIN IGN", "LPub3D", Meaning.PICTURE),
    MetaCommand("!LPUB BOM", "LPub3D", Meaning.PICTURE),
    MetaCommand("!LPUB CALLOUT", "LPub3D", Meaning.PICTURE),
    MetaCommand("!LPUB MULTI_STEP", "LPub3D", Meaning.PICTURE),
    MetaCommand("!LPUB NOSTEP", "LPub3D", Meaning.PICTURE),
    MetaCommand("!LPUB INSERT", "LPub3D", Meaning.PICTURE),
    MetaCommand("!LPUB REMOVE", "LPub3D", Meaning.PICTURE),
    MetaCommand("!LPUB", "LPub3D", Meaning.PICTURE),
    MetaCommand("LPUB", "LPub", Meaning.PICTURE),
    MetaCommand("PLIST", "LPub", Meaning.PICTURE),
    MetaCommand("BI", "LPub", Meaning.PICTURE),
    MetaCommand("!FADE", "LPub3D", Meaning.PICTURE),
    MetaCommand("!SILHOUETTE", "LPub3D", Meaning.PICTURE),
    MetaCommand("MLCAD BTG", "MLCad", Meaning.PICTURE),
    MetaCommand("MLCAD ARROW", "MLCad", Meaning.PICTURE),
    MetaCommand("MLCAD", "MLCad", Meaning.PICTURE),
    MetaCommand("GROUP", "MLCad", Meaning.PICTURE),
    MetaCommand("BACKGROUND", "MLCad", Meaning.PICTURE),
    MetaCommand("ROTATION", "MLCad", Meaning.PICTURE),
    MetaCommand("BUFEXCHG", "MLCad", Meaning.PICTURE),
    MetaCommand("!LEOCAD GROUP", "LeoCAD", Meaning.PICTURE),
    MetaCommand("!LEOCAD PIECE", "LeoCAD", Meaning.PICTURE),
    MetaCommand("!LEOCAD CAMERA", "LeoCAD", Meaning.PICTURE),
    MetaCommand("!LEOCAD LIGHT", "LeoCAD", Meaning.PICTURE),
    MetaCommand("!LEOCAD SYNTH", "LeoCAD", Meaning.PICTURE),
    MetaCommand("!LEOCAD MODEL", "LeoCAD", Meaning.PICTURE),
    MetaCommand("!LDCAD", "LDCad", Meaning.PICTURE),
    MetaCommand("CLEAR", "LDraw", Meaning.PICTURE),
    MetaCommand("PAUSE", "LDraw", Meaning.PICTURE),
    MetaCommand("SAVE", "LDraw", Meaning.PICTURE),
    MetaCommand("WRITE", "LDraw", Meaning.PICTURE),
    MetaCommand("PRINT", "LDraw", Meaning.PICTURE),
    MetaCommand("BFC", "LDraw", Meaning.PICTURE),
    MetaCommand("!TEXMAP", "LDraw", Meaning.PICTURE),
    MetaCommand("!DATA", "LDraw", Meaning.PICTURE),
    MetaCommand("!:", "LDraw", Meaning.PICTURE),
    MetaCommand("!COLOUR", "LDraw", Meaning.PICTURE),
    MetaCommand("!AVATAR", "LDraw", Meaning.PICTURE),
    MetaCommand("PE_TEX_PATH", "Studio", Meaning.PICTURE),
    MetaCommand("PE_TEX_INFO", "Studio", Meaning.PICTURE),
    MetaCommand("PE_TEX_NEXT_SHEAR", "Studio", Meaning.PICTURE),
    MetaCommand("CustomBrick", "Studio", Meaning.HEADER),
    MetaCommand("FlexibleBrickControlPointUnitLength", "Studio", Meaning.HEADER),
    MetaCommand("NumOfBricks:", "Studio", Meaning.HEADER),
    MetaCommand("BL_ITEM_NO", "Studio", Meaning.HEADER),
    MetaCommand("Name:", "LDraw", Meaning.HEADER),
    MetaCommand("Author:", "LDraw", Meaning.HEADER),
    MetaCommand("!LICENSE", "LDraw", Meaning.HEADER),
    MetaCommand("!CATEGORY", "LDraw", Meaning.HEADER),
    MetaCommand("!KEYWORDS", "LDraw", Meaning.HEADER),
    MetaCommand("!HISTORY", "LDraw", Meaning.HEADER),
    MetaCommand("!THEME", "LDraw", Meaning.HEADER),
    MetaCommand("!HELP", "LDraw", Meaning.HEADER),
    MetaCommand("!PREVIEW", "LDraw", Meaning.HEADER),
    MetaCommand("!CMDLINE", "LDraw", Meaning.HEADER),
)
"""All kinds. If a line begins with the words of two, the one with more words counts.
`docs/plans.md` has the same table, and a test compares them."""


@functools.cache
def _by_first_word() -> dict[str, list[tuple[list[str], Meaning]]]:
    """The words of each kind and its meaning, by the first word, the longest kinds first."""
    # Grouping the kinds by their first word keeps most of a file's lines, up to 100,000, from being
    # compared with any.
    kinds = defaultdict(list)
    for command in META_COMMANDS:
        words = command.words.split()
        kinds[words[0]].append((words, command.meaning))
    for same_word in kinds.values():
        # Longer patterns come first, because the general meaning of a program's line, as `!LPUB`,
        # would otherwise hide its particular ones.
        same_word.sort(key=lambda kind: len(kind[0]), reverse=True)
    return dict(kinds)


def meaning_of(words: Sequence[str]) -> Meaning | None:
    """Meaning of a line, by its words after the 0; ``None`` for a title, a comment, or an unknown
    command."""
    if not words:
        return None
    for pattern, meaning in _by_first_word().get(words[0], ()):
        if len(words) < len(pattern):
            continue
        # A line may have more words than the pattern, for names, numbers and comments.
        word_pairs = zip(pattern, words, strict=False)
        if all(expected in ("*", word) for expected, word in word_pairs):
            return meaning
    return None


class SynthKind(NamedTuple):
    """A kind of thing that LSynth draws.

    Attributes:
        is_band: whether it runs around parts, which are shown without being asked for.
        is_of_parts: whether its segments are real parts.
    """

    is_band: bool
    is_of_parts: bool


SYNTH_KINDS = {
    "TECHNIC_CHAIN_LINK": SynthKind(is_band=True, is_of_parts=True),
    "TECHNIC_CHAIN_LINK_WITH_TWO_STUDS": SynthKind(is_band=True, is_of_parts=True),
    "TECHNIC_CHAIN_TREAD": SynthKind(is_band=True, is_of_parts=True),
    "TECHNIC_CHAIN_TREAD_38": SynthKind(is_band=True, is_of_parts=True),
    "CHAIN": SynthKind(is_band=True, is_of_parts=True),
    "PLASTIC_TREAD": SynthKind(is_band=True, is_of_parts=True),
    "BRICK_ARC": SynthKind(is_band=False, is_of_parts=True),
    "RUBBER_BAND": SynthKind(is_band=True, is_of_parts=False),
    "RUBBER_BELT": SynthKind(is_band=True, is_of_parts=False),
    "STRING_BAND": SynthKind(is_band=True, is_of_parts=False),
    "TECHNIC_TREAD": SynthKind(is_band=True, is_of_parts=False),
    "TECHNIC_TREAD_CRAWLER": SynthKind(is_band=True, is_of_parts=False),
    "RUBBER_TREAD": SynthKind(is_band=True, is_of_parts=False),
}
"""The bands of LSynth, and what else is made of real parts; all other kinds are hoses, cables and
strings of one piece."""
_HOSE = SynthKind(is_band=False, is_of_parts=False)


def synth_kind(name: str) -> SynthKind:
    """The kind of that name, in letters of any case."""
    return SYNTH_KINDS.get(name.upper(), _HOSE)
