"""Code that a benchmark depends on: of all of our modules that it imports, at first or later, the
definitions that it can reach, as syntax trees without docstrings.

Two trees with one digest compute the same, whatever their comments, words and formatting are, and
whatever was changed in what the benchmark never calls.

What can be reached is found by names, so that too much counts rather than too little: a definition
counts if anything that counts mentions its name, as a name, an attribute or a text. What else a
module does when it is imported counts always, and so do all methods of a class that a library
calls, as its own base says, and what a decorator hands to somebody else.
"""

from __future__ import annotations

import ast
import hashlib
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

OURS = ("benchmarks", "brickhub", "bricktwin", "bricksrl")
HARNESS = tuple(
    f"benchmarks.{name}"
    for name in ("session", "registry", "machine", "provenance", "code", "formatting", "tables")
)
"""Modules that start benchmarks, and keep and show results, but change none."""
_NAMED = re.compile(r"(?:brickhub|bricktwin|bricksrl)(?:\.\w+)+")
_BEGUN = re.compile(r"(?:brickhub|bricktwin|bricksrl)(?:\.\w+)*\.")
_WORD = re.compile(r"[A-Za-z_]\w*")
_TEXT = re.compile(r"[\w.:-]+")
"""A text that may name something, such as ``execute`` or ``bricksrl.agents.sac:SAC``."""
_PLAIN_DECORATORS = {
    "abstractmethod",
    "cache",
    "cached_property",
    "classmethod",
    "contextmanager",
    "dataclass",
    "lru_cache",
    "overload",
    "property",
    "staticmethod",
    "wraps",
}
"""Decorators that hand a definition to nobody but those who name it."""
_PLAIN_BASES = {
    "ABC",
    "BaseException",
    "Enum",
    "Exception",
    "Generic",
    "NamedTuple",
    "Protocol",
    "TypedDict",
    "object",
}
"""Bases of others that call no method but by a name with underscores."""
_ON_THE_HUB = ("onboard", "frozen")
"""Packages of programs for a hub, which are read as texts: all of them counts where they are
imported."""
Source = Callable[[str], str | None]
"""Text of a file of the repository by its path; ``None`` if there is no such file."""
_Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


@dataclass(frozen=True)
class _Piece:
    """A part of a module: a definition, a value with a name, or what it does besides.

    Attributes:
        module: in which it stands.
        place: where it stands, by names.
        name: by which others mention it; "" if it counts always.
        owner: place of the class that a method belongs to.
        uses: the names that it mentions.
        bases: of a class.
    """

    module: str
    place: str
    name: str
    owner: str
    digest: str
    uses: frozenset[str]
    bases: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Module:
    """A module.

    Attributes:
        imports: names of modules; one that ends with a point is a package of which some are loaded.
        texts: words in its texts.
    """

    imports: frozenset[str]
    texts: frozenset[str]
    is_package: bool
    pieces: tuple[_Piece, ...]


class Code:
    """The code at one commit, or in the working tree.

    Args:
        source: gives the files.
        paths: of all files.
    """

    def __init__(self, source: Source, paths: Iterable[str]) -> None:
        self._source = source
        self._names = sorted(filter(None, map(_module_at, paths)))
        self._modules: dict[str, _Module | None] = {}
        self._seen_from: dict[str, set[str]] = {}

    def digest(self, module: str) -> str:
        """Digest of what a module can reach."""
        parts = sorted(f"{piece.place} {piece.digest}" for piece in self.reached(module))
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]

    def reached(self, module: str) -> set[_Piece]:
        """The pieces of a module, and of all of ours that it imports, that can have an effect."""
        by_name: dict[str, list[_Piece]] = defaultdict(list)
        methods: dict[str, list[_Piece]] = defaultdict(list)
        classes: dict[str, list[_Piece]] = defaultdict(list)
        rests: dict[str, list[_Piece]] = {}
        waiting: list[_Piece] = []
        for name in sorted(self.closure(module)):
            pieces = self._read(name).pieces
            rests[name] = [piece for piece in pieces if not piece.name]
            for piece in pieces:
                by_name[piece.name].append(piece)
                if piece.owner:
                    methods[piece.owner].append(piece)
                if piece.bases:
                    classes[piece.name].append(piece)
            # What starts, and what a hub is given, counts as a whole.
            if name == module or name.split(".")[-2:-1] in [[one] for one in _ON_THE_HUB]:
                waiting += pieces
        found: set[_Piece] = set()
        found_classes: set[str] = set()
        used: set[str] = set()
        while waiting:
            piece = waiting.pop()
            if piece in found:
                continue
            found.add(piece)
            # A module is imported for any part of it, and the packages above it with it.
            for name in _with_packages(piece.module):
                waiting += rests.pop(name, ())
            if piece.bases:
                found_classes.add(piece.place)
                is_open = self._is_open(piece, classes)
                waiting += [
                    method
                    for method in methods[piece.place]
                    if is_open or _is_special(method.name) or method.name in used
                ]
            visible = self._visible(piece.module)
            for name in piece.uses:
                waiting += [
                    one
                    for one in by_name.get(name, ())
                    if (one.owner in found_classes if one.owner else one.module in visible)
                ]
            used |= piece.uses
        return found

    def _is_open(
        self,
        piece: _Piece,
        classes: dict[str, list[_Piece]],
        seen: frozenset[str] = frozenset(),
    ) -> bool:
        """Whether a library may call methods of a class: one of its bases is of others."""
        for base in piece.bases:
            if base in _PLAIN_BASES or base in seen:
                continue
            ours = [one for one in classes.get(base, ()) if one is not piece]
            above = seen | {base}
            if not ours or any(self._is_open(one, classes, above) for one in ours):
                return True
        return False

    def _visible(self, module: str) -> set[str]:
        """The modules whose names a module can mention: itself, what it imports, and what packages
        that it imports hand on."""
        if module not in self._seen_from:
            found = {module}
            waiting = list(self._imported(module))
            while waiting:
                name = waiting.pop()
                if name not in found and self._exists(name):
                    found.add(name)
                    waiting += self._imported(name) if self._read(name).is_package else ()
            self._seen_from[module] = found
        return self._seen_from[module]

    def closure(self, module: str) -> set[str]:
        """Names of a module and of all of ours that it imports."""
        found: set[str] = set()
        waiting = [module]
        while waiting:
            name = waiting.pop()
            if name in found or name in HARNESS or not self._exists(name):
                continue
            found.add(name)
            waiting += self._imported(name)
        return found

    def _imported(self, module: str) -> Iterator[str]:
        """Names of what a module imports, that may be modules."""
        read = self._read(module)
        for name in read.imports:
            if name.endswith("."):
                # Some of a package's modules, by a name that is made when they are loaded.
                for one in self._names:
                    if one.startswith(name) and one.rpartition(".")[2] in read.texts:
                        yield one
                continue
            yield name
            if name.rpartition(".")[2] in _ON_THE_HUB:
                yield from (one for one in self._names if one.startswith(f"{name}."))

    def _exists(self, module: str) -> bool:
        self._read(module)
        return self._modules[module] is not None

    def _read(self, module: str) -> _Module:
        if module not in self._modules:
            self._modules[module] = self._parse(module)
        return self._modules[module] or _Module(frozenset(), frozenset(), False, ())

    def _parse(self, module: str) -> _Module | None:
        for path, is_package in _paths(module):
            text = self._source(path)
            if text is not None:
                tree = ast.parse(text)
                package = module if is_package else module.rpartition(".")[0]
                imported = frozenset(_imports(tree, package, with_texts=is_package))
                without_docstrings(tree)
                texts = frozenset(_words_of_texts(tree))
                pieces = tuple(_pieces(module, tree, with_texts=not is_package))
                return _Module(imported, texts, is_package, pieces)
        return None


def _pieces(module: str, tree: ast.Module, *, with_texts: bool) -> Iterator[_Piece]:
    """The parts of a module. ``with_texts``: whether texts name what they mention; those of a
    package name the modules that hold its parts, which others mention where they use them."""
    rest: list[ast.stmt] = []
    for statement in tree.body:
        if isinstance(statement, ast.ClassDef):
            yield from _parts_of_class(module, statement, with_texts=with_texts)
        elif isinstance(statement, _Definition):
            name = "" if _is_handed_over(statement) else statement.name
            yield _piece(module, f"{module}.{statement.name}", name, "", [statement], with_texts)
        elif (assigned := _assigned(statement)) is not None:
            yield _piece(module, f"{module}.{assigned}", assigned, "", [statement], with_texts)
        elif not isinstance(statement, ast.Import | ast.ImportFrom) or _has_other_names(statement):
            rest.append(statement)
    yield _piece(module, module, "", "", rest, with_texts)


def _parts_of_class(module: str, node: ast.ClassDef, *, with_texts: bool) -> Iterator[_Piece]:
    place = f"{module}.{node.name}"
    kept: list[ast.stmt] = []
    for statement in node.body:
        if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef):
            is_handed = _is_handed_over(statement)
            # What is handed over has a name that is special: it counts with its class.
            name = f"__{statement.name}__" if is_handed else statement.name
            yield _piece(module, f"{place}.{statement.name}", name, place, [statement], with_texts)
        else:
            kept.append(statement)
    shell = ast.ClassDef(
        name=node.name,
        bases=node.bases,
        keywords=node.keywords,
        body=kept or [ast.Pass()],
        decorator_list=node.decorator_list,
    )
    bases = tuple(base for one in node.bases for base in [_last_name(one)] if base is not None) or (
        "object",
    )
    name = "" if _is_handed_over(node) else node.name
    yield replace(_piece(module, place, name, "", [shell], with_texts), bases=bases)


def _piece(
    module: str, place: str, name: str, owner: str, nodes: list[ast.stmt], with_texts: bool
) -> _Piece:
    dumped = "\n".join(map(ast.dump, nodes))
    uses = frozenset(word for node in nodes for word in _words(node, with_texts=with_texts))
    digest = hashlib.sha256(dumped.encode()).hexdigest()
    return _Piece(module, place, name, owner, digest, uses)


def _words(node: ast.AST, *, with_texts: bool) -> Iterator[str]:
    """The names that a node mentions."""
    for one in ast.walk(node):
        match one:
            case ast.Name(id=name) | ast.Attribute(attr=name):
                yield name
            case ast.keyword(arg=str(name)):
                yield name
            case ast.alias(name=name, asname=str()):
                yield name.rpartition(".")[2]
            case ast.Constant(value=str(text)) if with_texts and _TEXT.fullmatch(text):
                yield from _WORD.findall(text)
            case ast.MatchClass(kwd_attrs=names):
                yield from names


def _words_of_texts(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield from _WORD.findall(node.value)


def _is_handed_over(node: _Definition) -> bool:
    """Whether a decorator may hand a definition to somebody who does not name it."""
    for decorator in node.decorator_list:
        called = decorator.func if isinstance(decorator, ast.Call) else decorator
        name = _last_name(called)
        if name not in _PLAIN_DECORATORS and name not in ("setter", "getter", "deleter"):
            return True
    return False


def _last_name(node: ast.expr) -> str | None:
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name
        case ast.Subscript(value=value) | ast.Call(func=value):
            return _last_name(value)
    return None


def _assigned(statement: ast.stmt) -> str | None:
    match statement:
        case ast.Assign(targets=[ast.Name(id=name)]) | ast.AnnAssign(target=ast.Name(id=name)):
            return name
    return None


def _has_other_names(statement: ast.Import | ast.ImportFrom) -> bool:
    return any(alias.asname not in (None, alias.name) for alias in statement.names)


def _is_special(name: str) -> bool:
    return name.startswith("__") and name.endswith("__")


def without_docstrings(tree: ast.AST) -> None:
    """Remove all texts that are statements."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if not isinstance(body, list):
            continue
        kept = [statement for statement in body if not _is_text(statement)]
        # A body that was a docstring alone must not be empty.
        node.body = kept or [ast.Pass()]  # type: ignore[attr-defined]


def _is_text(statement: ast.stmt) -> bool:
    if not isinstance(statement, ast.Expr) or not isinstance(statement.value, ast.Constant):
        return False
    return isinstance(statement.value.value, str)


def _paths(module: str) -> Iterator[tuple[str, bool]]:
    """Paths at which a module may be, and whether it is a package there."""
    house = module.partition(".")[0]
    place = module.replace(".", "/")
    root = "" if house == "benchmarks" else f"packages/{house}/src/"
    yield f"{root}{place}.py", False
    yield f"{root}{place}/__init__.py", True
    # Before the three houses there was one.
    yield f"src/{place}.py", False
    yield f"src/{place}/__init__.py", True


def _imports(
    tree: ast.AST,
    package: str,
    *,
    with_texts: bool,
) -> Iterator[str]:
    """Names of our modules that a tree imports; what may be a module or something in it counts as
    both. ``with_texts``: those in texts too, as a package's that loads its parts when they are
    used."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if _is_ours(alias.name))
        elif isinstance(node, ast.ImportFrom):
            parent = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                parent = ".".join([*above, *filter(None, [parent])])
            if _is_ours(parent):
                yield parent
                yield from (f"{parent}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.JoinedStr):
            yield from _made_names(node, package)
        elif with_texts and isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield from _NAMED.findall(node.value)


def _made_names(node: ast.JoinedStr, package: str) -> Iterator[str]:
    """The module whose name is made, or its package with a point: ``f"bricksrl.agents.{name}"``."""
    match node.values:
        case [ast.Constant(value=str(text)), ast.FormattedValue()] if _BEGUN.fullmatch(text):
            yield text
        case [
            ast.FormattedValue(value=ast.Name(id="__name__" | "__package__")),
            ast.Constant(value=str(text)),
            *rest,
        ] if text.endswith(".") or not rest:
            yield f"{package}{text}"


def _module_at(path: str) -> str | None:
    """Name of the module of ours that is at a path."""
    found = re.fullmatch(r"(?:packages/\w+/src/|src/)?((?:\w+/)*\w+)\.py", path)
    name = found[1].replace("/", ".").removesuffix(".__init__") if found else ""
    return name if _is_ours(name) else None


def _with_packages(module: str) -> list[str]:
    """A module, and the packages that it lies in."""
    parts = module.split(".")
    return [".".join(parts[:count]) for count in range(len(parts), 0, -1)]


def _is_ours(module: str) -> bool:
    return module.partition(".")[0] in OURS
