"""JavaScript of the view: modules in ``static/``, to be served as they are, or one text for a page
that is a single file."""

import re
from importlib import resources

FOLDER = resources.files("bricktwin.view") / "static"
_IMPORT = re.compile(r'^import \{[^}]*\} from "\./(?P<file>\w+\.js)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(const|class|function)\b)", re.MULTILINE)


def one_script(name: str) -> str:
    """A module with all that it imports as one text, without imports and exports, for a page that
    is opened as a file: browsers refuse modules there. No two modules have one name at their top
    level."""
    texts: dict[str, str] = {}
    _collect(name, texts)
    return "\n".join(texts.values())


def _collect(name: str, texts: dict[str, str]) -> None:
    """Add the text of a module after those that it imports."""
    text = (FOLDER / name).read_text(encoding="utf-8")
    for imported in _IMPORT.finditer(text):
        if imported["file"] not in texts:
            _collect(imported["file"], texts)
    texts[name] = _EXPORT.sub("", _IMPORT.sub("", text))
