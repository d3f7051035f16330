"""Transformation of a hub program, so that CPython computes, formats and refuses as a hub.

Line numbers stay. The names of the helpers, in ``operators.py`` and ``attributes.py``, contain an
``@``, which no program can write. ``async for`` and ``async with`` are expanded as by the hub's
compiler, in a coroutine that is a generator.
"""

import ast
import copy
import operator
from collections.abc import Callable, Collection
from typing import Any

from brickhub.virtual.micropython.attributes import may_be_hidden
from brickhub.virtual.micropython.floats import SMALL_MAX, SMALL_MIN, read_constant
from brickhub.virtual.micropython.operators import ASCII_METHODS

# The hub's compiler folds these operations on constants. It runs on a computer, so integers have
# any size there; `/` it leaves to the hub.
_FOLDED: dict[type[ast.operator], Callable[[int, int], int]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
    ast.LShift: operator.lshift,
    ast.RShift: operator.rshift,
    ast.BitOr: operator.or_,
    ast.BitAnd: operator.and_,
    ast.BitXor: operator.xor,
}
_SIGNS: dict[type[ast.unaryop], Callable[[int], int]] = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Invert: operator.invert,
}
_MAX_BITS = 4096
"""Limit of a folded power or shift: larger ones take time, and no result of that size fits."""
# CPython computes these itself and only the result is checked, because no operand has to be
# converted first.
_WRAPPED = (ast.Add, ast.Sub, ast.LShift)
_ARITHMETIC = {
    ast.Mult: "@mul",
    ast.Div: "@div",
    ast.FloorDiv: "@floordiv",
    ast.Mod: "@mod",
    ast.Pow: "@pow",
}
_CALLED = {**_ARITHMETIC, ast.BitAnd: "@and", ast.BitOr: "@or", ast.BitXor: "@xor"}
_IN_PLACE = {
    ast.Add: "@iadd",
    ast.Sub: "@isub",
    ast.BitAnd: "@iand",
    ast.BitOr: "@ior",
    ast.BitXor: "@ixor",
}
"""Operators that can change a value in place on a hub; for others ``a *= b`` is ``a = a * b``."""
_CONVERSIONS = ("int", "float", "str", "slice")
# These methods differ on a hub, whatever object has them.
_METHODS = ("format", "to_bytes", "from_bytes", "sort", "throw", "close", *ASCII_METHODS)
# The helpers of these take one argument. Another number is refused as with any function.
_OF_ITERABLES = ("list", "tuple", "bytes")
_ORDERS: dict[type[ast.cmpop], str] = {
    ast.Lt: "@lt",
    ast.LtE: "@le",
    ast.Gt: "@gt",
    ast.GtE: "@ge",
}
# CPython's classes can be indexed, as list[int], which a hub refuses.
_GENERIC = ("list", "tuple", "dict", "set", "type", "enumerate", "map", "zip", "reversed")
# A loop has to look whether the heap is full only if it has one of these expressions.
_TAKE_MEMORY = (ast.Call, ast.List, ast.Tuple)
_TOP_DOWN = (
    ast.UnaryOp,
    ast.BinOp,
    ast.Expr,
    ast.Call,
    ast.Assign,
    ast.AnnAssign,
    ast.arg,
    ast.ClassDef,
    ast.FunctionDef,
    ast.AsyncFunctionDef,
    ast.GeneratorExp,
    ast.ListComp,
    ast.DictComp,
    ast.SetComp,
)
"""Nodes of which a part is looked at before it is transformed; of all others the parts come
first."""
COMPREHENSIONS = ("@listcomp", "@dictcomp", "@setcomp")
"""Functions that return their argument, an element; the hub's names of the functions that they are
called in, after ``@``."""
_EMITTERS = ("micropython.native", "micropython.viper", "micropython.bytecode")
# The hub's compiler keeps the iterator of `async for x in name` in the variable `name` itself.
_FOR = """
ITER = VALUE.__aiter__()
MORE = True
while MORE:
    try:
        TARGET = yield from ITER.__anext__()
    except StopAsyncIteration:
        MORE = False
    else:
        BODY
else:
    ELSE
"""
# A hub has no __class__, so any exception in an `async with` ends as AttributeError.
_WITH = """
CONTEXT = VALUE
TARGET = yield from CONTEXT.__aenter__()
LEFT = False
try:
    try:
        BODY
    except ANY as ERROR:
        LEFT = True
        if not (yield from CONTEXT.__aexit__(ATTRIBUTE(ERROR, "__class__"), ERROR, None)):
            raise
finally:
    if not LEFT:
        yield from CONTEXT.__aexit__(None, None, None)
"""


def called_name(node: ast.Call) -> str:
    """Name of the called function; that of a method begins with a point."""
    function = node.func
    if isinstance(function, ast.Name):
        return function.id
    if isinstance(function, ast.Attribute):
        return f".{function.attr}"
    return ""


def call(
    name: str,
    *args: ast.expr,
    at: ast.AST,
) -> ast.Call:
    """A call of a helper, whose name programs cannot write, at the place of another node."""
    helper = ast.Name(name, ast.Load())
    return ast.copy_location(ast.Call(helper, list(args), []), at)


def _load(name: str) -> ast.expr:
    return ast.Name(name, ast.Load())


def _store(name: str) -> ast.expr:
    return ast.Name(name, ast.Store())


def _statement(value: ast.expr, at: ast.AST) -> ast.stmt:
    """An expression as a statement, at the place of another node."""
    return ast.copy_location(ast.Expr(value), at)


def _assignment(
    target: ast.expr,
    value: ast.expr,
    at: ast.AST,
) -> ast.Assign:
    return ast.copy_location(ast.Assign([target], value), at)


def _never(statement: ast.stmt, at: ast.AST) -> ast.stmt:
    """``if False: statement``, for the names that it makes local, or its ``yield``."""
    return ast.copy_location(ast.If(ast.Constant(False), [statement], []), at)


def fold(node: ast.expr) -> int | None:
    """Constant folded by the hub's compiler, or ``None``; it runs on a PC, so only the result has
    to fit 31 bits."""
    if isinstance(node, ast.Constant):
        return node.value if type(node.value) is int else None
    if isinstance(node, ast.UnaryOp):
        sign = _SIGNS.get(type(node.op))
        value = fold(node.operand)
        if sign is None or value is None:
            return None
        return sign(value)
    if not isinstance(node, ast.BinOp):
        return None
    kind = type(node.op)
    operation = _FOLDED.get(kind)
    if operation is None:
        return None
    left = fold(node.left)
    right = fold(node.right)
    if left is None or right is None:
        return None
    # An operation that fails, or gives a float, is left to fail when the program comes to it.
    if kind in (ast.FloorDiv, ast.Mod) and right == 0:
        return None
    if kind in (ast.Pow, ast.LShift, ast.RShift) and right < 0:
        return None
    if kind is ast.Pow and left.bit_length() * right > _MAX_BITS:
        return None
    if kind is ast.LShift and right > _MAX_BITS:
        return None
    return operation(left, right)


def transform(
    tree: ast.Module | ast.Expression,
    recursive: Collection[str] = (),
    floats: Collection[str] = (),
) -> ast.Module | ast.Expression:
    """The transformed program. ``recursive``: `called_name` of functions that may call themselves.
    ``floats``: text of the compiled program's floats. Raises OverflowError if a constant needs more
    than 31 bits."""
    transformed = _Transformer(recursive, floats).visit(tree)
    return ast.fix_missing_locations(transformed)  # type: ignore[no-any-return]


def _bounds(part: ast.Slice) -> list[ast.expr]:
    # The helpers take all three bounds, and brackets may leave out any of them.
    return [bound or ast.Constant(None) for bound in (part.lower, part.upper, part.step)]


class _Transformer(ast.NodeTransformer):
    def __init__(
        self,
        recursive: Collection[str],
        floats: Collection[str],
    ) -> None:
        self._recursive = recursive
        self._floats = floats
        self._named: dict[str, ast.expr] = {}
        """Values of names such as ``SPEED = const(100)``, which the hub's compiler puts in the
        place of the name."""
        self._classes: set[str] = set()
        """Names of what ``type(...)`` returned."""
        self._globals: Collection[str] | None = None
        """Names that the function or class around declares global; ``None`` outside of them, where
        all are."""

    def visit(self, node: ast.AST) -> Any:
        if not isinstance(node, _TOP_DOWN):
            self.generic_visit(node)
        method = getattr(self, f"visit_{type(node).__name__}", None)
        return node if method is None else method(node)

    def visit_Name(self, node: ast.Name) -> ast.expr:
        is_constant = node.id in self._named and isinstance(node.ctx, ast.Load)
        # Each place gets a copy, because a transformed node may be changed again.
        return copy.deepcopy(self._named[node.id]) if is_constant else node

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        if type(node.value) is float:
            node.value = read_constant(node.value, self._floats)
        elif type(node.value) is int and not SMALL_MIN <= node.value <= SMALL_MAX:
            raise OverflowError("long int not supported in this build")
        return node

    def visit_BinOp(self, node: ast.BinOp | ast.UnaryOp) -> ast.expr:
        # This is tried before the parts are looked at: 2**40 - 2**40 is right, although neither
        # part is.
        folded = fold(node)
        if folded is not None:
            return self.visit_Constant(ast.copy_location(ast.Constant(folded), node))
        self.generic_visit(node)
        kind = type(node.op)
        if kind in _WRAPPED:
            return call("@n", node, at=node)
        if isinstance(node, ast.BinOp) and kind in _CALLED:
            return call(
                _CALLED[kind],
                node.left,
                node.right,
                at=node,
            )
        return node

    visit_UnaryOp = visit_BinOp

    def visit_Expr(self, node: ast.Expr) -> ast.AST:
        """The hub's compiler drops a number that stands alone, even a large one."""
        is_number = isinstance(node.value, ast.BinOp) and fold(node.value) is not None
        if is_number:
            return ast.copy_location(ast.Pass(), node)
        return self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.AST | list[ast.stmt]:
        target = node.target
        if isinstance(target, ast.Name):
            return self._augment_name(target, node)
        # Owner and index are computed once, before the value, as in `a[f()] += g()`.
        statements: list[ast.stmt] = [self._assign("@owner", target.value, node)]
        owner: ast.expr = _load("@owner")
        read: ast.expr
        write: ast.expr
        if isinstance(target, ast.Attribute):
            read = ast.Attribute(owner, target.attr, ast.Load())
            write = ast.Attribute(owner, target.attr, ast.Store())
        else:
            statements.append(self._assign("@index", target.slice, node))
            index = _load("@index")
            read = ast.Subscript(owner, index, ast.Load())
            write = ast.Subscript(owner, index, ast.Store())
        new_value = self._operate(read, node)
        assign = _assignment(write, new_value, node)
        statements.append(self._store_statement(assign))
        return statements

    def _augment_name(
        self,
        target: ast.Name,
        node: ast.AugAssign,
    ) -> ast.AST | list[ast.stmt]:
        kind = type(node.op)
        read = _load(target.id)
        # `a += 1` stays as it is, and a second statement checks its result, which is the fastest
        # form for what loops do most. Any other right side of `+=` may be an iterable, which a hub
        # adds to a list in its own way.
        adds_constant = kind is ast.Add and isinstance(node.value, ast.Constant)
        if kind is ast.Sub or adds_constant:
            checked = call("@n", read, at=node)
            return [node, _assignment(target, checked, node)]
        return _assignment(target, self._operate(read, node), node)

    @staticmethod
    def _operate(read: ast.expr, node: ast.AugAssign) -> ast.expr:
        """The new value of the target of ``a += b``."""
        kind = type(node.op)
        helper = _IN_PLACE.get(kind) or _ARITHMETIC.get(kind)
        if helper is not None:
            return call(helper, read, node.value, at=node)
        operation = ast.BinOp(read, node.op, node.value)
        return call("@n", ast.copy_location(operation, node), at=node)

    @staticmethod
    def _store_statement(node: ast.Assign) -> ast.stmt:
        """Statement for ``owner.name = value``, which fails if the owner accepts no attributes."""
        if len(node.targets) > 1 or not isinstance(node.targets[0], ast.Attribute):
            return node
        target = node.targets[0]
        name = ast.Constant(target.attr)
        store = call(
            "@store",
            node.value,
            target.value,
            name,
            at=node,
        )
        return _statement(store, node)

    @staticmethod
    def _assign(
        name: str,
        value: ast.expr,
        at: ast.AST,
    ) -> ast.stmt:
        # A slice can stand only in brackets.
        if isinstance(value, ast.Slice):
            value = call("slice", *_bounds(value), at=at)
        return _assignment(_store(name), value, at)

    def visit_Call(self, node: ast.Call) -> ast.expr:
        function = node.func
        # This is looked at before the parts are transformed, which may hide the called name.
        is_recursive = called_name(node) in self._recursive
        has_one_argument = len(node.args) == 1 and not node.keywords
        is_of_one = has_one_argument and not isinstance(node.args[0], ast.Starred)
        # A program's own method of such a name has to be called directly, so that its calls are
        # counted.
        methods = (*_METHODS, "extend", "join") if is_of_one and not is_recursive else _METHODS
        self.generic_visit(node)
        if isinstance(function, ast.Name):
            converts_iterable = is_of_one and function.id in _OF_ITERABLES
            if function.id in _CONVERSIONS or converts_iterable:
                return self._call_helper(node, "convert", function)
        if isinstance(function, ast.Attribute) and function.attr in methods:
            return self._call_helper(node, function.attr, function.value)
        if node.keywords:
            node.func = call("@keywords", node.func, at=node)
        if is_recursive:
            node.func = call("@callee", node.func, at=node)
        return node

    @staticmethod
    def _call_helper(
        node: ast.Call,
        name: str,
        subject: ast.expr,
    ) -> ast.Call:
        node.args.insert(0, subject)
        node.func = ast.copy_location(_load("@" + name), node.func)
        return node

    def visit_Starred(self, node: ast.Starred) -> ast.expr:
        """Arguments ``*values``."""
        if isinstance(node.ctx, ast.Load):
            node.value = call("@star", node.value, at=node.value)
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        if isinstance(node.ctx, ast.Load) and may_be_hidden(node.attr):
            return call(
                "@attr",
                node.value,
                ast.Constant(node.attr),
                at=node,
            )
        return node

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        index = node.slice
        owner = node.value
        # CPython might take `type(x)[0]`, `list[int]` and what `type(...)` made for types.
        is_class = isinstance(owner, ast.Call) and called_name(owner) == "type"
        if isinstance(owner, ast.Name):
            is_class = owner.id in _GENERIC or owner.id in self._classes
        if is_class:
            node.value = call("@sub", node.value, at=node.value)
        is_read = isinstance(node.ctx, ast.Load)
        if is_read and isinstance(index, ast.Slice) and index.step is not None:
            return call(
                "@stepped",
                node.value,
                *_bounds(index),
                at=node,
            )
        return node

    def visit_Assign(self, node: ast.Assign) -> ast.AST:
        target = node.targets[0]
        is_single = len(node.targets) == 1
        if isinstance(target, ast.Name):
            constant = _argument_of_const(node.value) if is_single else None
            if constant is not None:
                value = self.visit(constant)
                # The constant stands wherever the name is read from here on, in whatever scope.
                self._named[target.id] = value
                # A private name itself is in no namespace.
                if target.id.startswith("_"):
                    return ast.copy_location(ast.Pass(), node)
                node.value = copy.deepcopy(value)
                return node
            if isinstance(node.value, ast.Call) and called_name(node.value) == "type":
                self._classes.add(target.id)
        self.generic_visit(node)
        if not is_single or not isinstance(target, ast.Subscript):
            return self._store_statement(node)
        if not isinstance(target.slice, ast.Slice):
            return node
        bounds = _bounds(target.slice)
        store = call(
            "@setslice",
            node.value,
            target.value,
            *bounds,
            at=node,
        )
        return _statement(store, node)

    def visit_Dict(self, node: ast.Dict) -> ast.expr:
        # A hub computes each value before its key.
        parts: list[ast.expr] = []
        for value, key in zip(node.values, node.keys, strict=True):
            parts.append(value)
            # `None` stands for `**`, which the hub's compiler has already refused.
            if key is not None:
                parts.append(key)
        return call("@dict", *parts, at=node)

    def visit_Set(self, node: ast.Set) -> ast.expr:
        return call("@set", *node.elts, at=node)

    def visit_GeneratorExp(
        self,
        node: ast.GeneratorExp | ast.ListComp,
        branch: str = "@turn",
    ) -> ast.expr:
        """A loop: it branches after each element, and at each condition."""
        self.generic_visit(node)
        node.elt = call(branch, node.elt, at=node.elt)
        return node

    def visit_ListComp(
        self,
        node: ast.ListComp,
        element: str = "@listcomp",
    ) -> ast.expr:
        """A function of its own as on a hub, which a list comprehension of CPython is no more from
        3.12 on."""
        if any(isinstance(part, ast.Await) for part in ast.walk(node)):
            return self.visit_GeneratorExp(node)
        generator = ast.copy_location(ast.GeneratorExp(node.elt, node.generators), node)
        return call("@listof", self.visit_GeneratorExp(generator, element), at=node)

    def visit_DictComp(self, node: ast.DictComp) -> ast.expr:
        pair = ast.Tuple([node.value, node.key], ast.Load())
        pairs = ast.copy_location(ast.ListComp(pair, node.generators), node)
        return call("@dictof", self.visit_ListComp(pairs, "@dictcomp"), at=node)

    def visit_SetComp(self, node: ast.SetComp) -> ast.expr:
        elements = ast.copy_location(ast.ListComp(node.elt, node.generators), node)
        return call("@setof", self.visit_ListComp(elements, "@setcomp"), at=node)

    def visit_comprehension(self, node: ast.comprehension) -> ast.comprehension:
        node.ifs = [call("@branch", test, at=test) for test in node.ifs]
        return node

    def visit_Lambda(self, node: ast.Lambda) -> ast.expr:
        # `lambda **names: body` becomes `lambda **names: (lambda names: body)(@named(names))`,
        # because a lambda has no place for a statement that converts the dict.
        if node.args.kwarg is not None:
            name = node.args.kwarg.arg
            parameters = ast.arguments(
                [],
                [ast.arg(name)],
                None,
                [],
                [],
                None,
                [],
            )
            inner = ast.Lambda(parameters, node.body)
            converted = call("@named", _load(name), at=node)
            node.body = ast.copy_location(ast.Call(inner, [converted], []), node)
        return node

    def _convert_kwargs(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> list[ast.stmt]:
        """Conversion of ``**kwargs`` to a hub's dict."""
        if node.args.kwarg is None:
            return []
        name = node.args.kwarg.arg
        converted = call("@named", _load(name), at=node)
        return [self._assign(name, converted, node)]

    def visit_Delete(self, node: ast.Delete) -> list[ast.stmt]:
        statements: list[ast.stmt] = []
        for target in node.targets:
            # A hub raises KeyError for a global that is missing.
            if isinstance(target, ast.Name) and self._is_global(target.id):
                name = ast.Constant(target.id)
                delete: ast.stmt = ast.Expr(call("@del", name, at=node))
            else:
                delete = ast.Delete([target])
            if isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Slice):
                step = target.slice.step or ast.Constant(None)
                target.value = call(
                    "@sliced",
                    target.value,
                    step,
                    at=target,
                )
            statements.append(ast.copy_location(delete, node))
        return statements

    def _is_global(self, name: str) -> bool:
        return self._globals is None or name in self._globals

    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        # This applies only where a constant tells that a hub's answer may differ, because a helper
        # for each comparison would make all loops slower.
        left = node.left
        operation = node.ops[0]
        right = node.comparators[0]
        is_single = len(node.ops) == 1
        if not is_single:
            return node
        helper = _ORDERS.get(type(operation))
        if helper is not None:
            has_text = _is_text(left) or _is_text(right)
            return call(helper, left, right, at=node) if has_text else node
        is_data = isinstance(right, ast.Constant) and isinstance(right.value, bytes)
        has_constant = isinstance(left, ast.Constant) or is_data
        if not isinstance(operation, ast.In | ast.NotIn) or not has_constant:
            return node
        contains = call("@in", left, right, at=node)
        if isinstance(operation, ast.In):
            return contains
        return ast.copy_location(ast.UnaryOp(ast.Not(), contains), node)

    def visit_Import(self, node: ast.Import) -> ast.AST | list[ast.stmt]:
        """On a hub ``import a.b`` returns ``a.b``, and ``as`` looks for another ``b`` in it."""
        statements: list[ast.stmt] = []
        for alias in node.names:
            if alias.asname is None or "." not in alias.name:
                statements.append(ast.copy_location(ast.Import([alias]), node))
                continue
            value: ast.expr = call("__import__", ast.Constant(alias.name), at=node)
            for part in alias.name.split(".")[1:]:
                value = ast.copy_location(ast.Attribute(value, part, ast.Load()), node)
            statements.append(self._assign(alias.asname, value, node))
        return statements

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.expr:
        if all(isinstance(part, ast.Constant) for part in node.values):
            return node
        # CPython would format the values in its own way, so a `"".join((...))` of texts is built
        # instead.
        join = ast.Attribute(ast.Constant(""), "join", ast.Load())
        parts = ast.Tuple(node.values, ast.Load())
        return ast.copy_location(ast.Call(join, [parts], []), node)

    def visit_FormattedValue(self, node: ast.FormattedValue) -> ast.expr:
        spec = node.format_spec or ast.Constant("")
        return call(
            "@f",
            node.value,
            ast.Constant(node.conversion),
            spec,
            at=node,
        )

    def visit_ExceptHandler(self, node: ast.ExceptHandler) -> ast.AST:
        """A program must not catch the exceptions that stop it from outside."""
        is_base = isinstance(node.type, ast.Name) and node.type.id == "BaseException"
        if node.type is None or is_base:
            node.type = ast.copy_location(_load("@any"), node)
        # The hub's message is made only for a program that looks at it.
        if node.name is not None:
            reword = call("@reword", _load(node.name), at=node)
            node.body.insert(0, _statement(reword, node))
        return node

    def visit_Try(self, node: ast.Try) -> ast.AST:
        """Neither a hub that is switched off runs a ``finally``, nor a generator that is
        dropped."""
        if node.finalbody:
            at = node.finalbody[0]
            guarded = ast.If(call("@ends", at=at), node.finalbody, [])
            node.finalbody = [ast.copy_location(guarded, at)]
        return node

    def visit_With(self, node: ast.With) -> ast.AST:
        for item in node.items:
            value = item.context_expr
            item.context_expr = call(
                "@with",
                value,
                _load("@reword"),
                at=value,
            )
        return node

    def visit_If(self, node: ast.If | ast.IfExp) -> ast.AST:
        node.test = call("@branch", node.test, at=node.test)
        return node

    visit_IfExp = visit_If

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        # The last value is the result, and nothing branches on it here.
        *tests, last = node.values
        branches = [call("@branch", value, at=value) for value in tests]
        node.values = [*branches, last]
        return node

    def visit_While(self, node: ast.While) -> ast.AST:
        # On a hub `while True` has no branch either.
        if not isinstance(node.test, ast.Constant):
            node.test = call("@branch", node.test, at=node.test)
        tick = call("@tick", at=node)
        node.body.insert(0, _statement(tick, node))
        return node

    def visit_For(self, node: ast.For) -> ast.AST | list[ast.stmt]:
        # A loop that only computes ends soon and takes no memory, so it runs at full speed.
        if not any(_takes_memory(statement) for statement in node.body):
            return node
        first = node.body[0]
        turn = call("@turn", ast.Constant(None), at=first)
        node.body.insert(0, _statement(turn, first))
        # A hub branches once more when a loop ends.
        branch = call("@branch", ast.Constant(None), at=node)
        return [node, _statement(branch, node)]

    def visit_arg(self, node: ast.arg) -> ast.AST:
        # The hub's compiler skips annotations, whatever names are in them.
        node.annotation = None
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        """An annotation without a value only makes a name local."""
        value = node.value or ast.Constant(None)
        assign = _assignment(node.target, value, node)
        if node.value is None:
            return _never(assign, node)
        self.generic_visit(assign)
        return assign

    def _visit_scope(self, node: ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) -> None:
        # `@micropython.native` and the like are directives to the compiler, and are left out.
        node.decorator_list = [
            decorator
            for decorator in node.decorator_list
            if ast.unparse(decorator) not in _EMITTERS
        ]
        around = self._globals
        declared: list[str] = []
        for part in ast.walk(node):
            if isinstance(part, ast.Global):
                declared += part.names
        self._globals = declared
        self.generic_visit(node)
        self._globals = around

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        """A hub ignores ``__slots__``: every object has a dictionary."""
        self._visit_scope(node)
        assignments = [part for part in node.body if isinstance(part, ast.Assign)]
        for statement in assignments:
            for target in statement.targets:
                if isinstance(target, ast.Name) and target.id == "__slots__":
                    target.id = "@slots"
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        node.returns = None
        self._visit_scope(node)
        node.body = [*self._convert_kwargs(node), *node.body]
        return node

    def visit_AsyncFunctionDef(self, node: ast.AsyncFunctionDef) -> ast.AST:
        """On a hub a coroutine is a generator, and ``await`` is ``yield from``."""
        self._visit_scope(node)
        # A `yield` makes the function a generator, even one that awaits nothing.
        generates = _never(ast.Expr(ast.Yield(None)), node)
        body = [generates, *self._convert_kwargs(node), *node.body]
        function = ast.FunctionDef(
            node.name,
            node.args,
            body,
            node.decorator_list,
        )
        return ast.copy_location(function, node)

    def visit_AsyncFor(self, node: ast.AsyncFor) -> list[ast.stmt]:
        parts = {"VALUE": node.iter, "TARGET": node.target}
        kept = {"ITER": node.iter.id} if isinstance(node.iter, ast.Name) else {}
        return _fill(
            _FOR,
            node,
            parts,
            {"BODY": node.body, "ELSE": node.orelse},
            kept,
        )

    def visit_AsyncWith(self, node: ast.AsyncWith) -> list[ast.stmt]:
        # `async with a, b` is `async with a` around `async with b`, so the last one is built first.
        body = node.body
        for item in reversed(node.items):
            target = item.optional_vars or _store("@unused")
            value = item.context_expr
            body = _fill(
                _WITH,
                value,
                {"VALUE": value, "TARGET": target},
                {"BODY": body},
                {},
            )
        return body

    def visit_Await(self, node: ast.Await) -> ast.expr:
        return ast.copy_location(ast.YieldFrom(node.value), node)


def _argument_of_const(value: ast.expr) -> ast.expr | None:
    """The argument of ``const(value)``, a directive to the compiler; ``None`` if it is none."""
    if not isinstance(value, ast.Call) or not value.args:
        return None
    return value.args[0] if called_name(value) == "const" else None


def _is_text(node: ast.expr) -> bool:
    """Whether an expression is text or bytes that stand in the program."""
    return isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)


def _takes_memory(statement: ast.stmt) -> bool:
    return any(isinstance(part, _TAKE_MEMORY) for part in ast.walk(statement))


def _fill(
    template: str,
    at: ast.expr | ast.stmt,
    parts: dict[str, ast.expr],
    blocks: dict[str, list[ast.stmt]],
    names: dict[str, str],
) -> list[ast.stmt]:
    """Statements of a template at the place of a node, with transformed parts."""
    tree = ast.parse(template)
    for node in ast.walk(tree):
        if hasattr(node, "lineno"):
            ast.copy_location(node, at)
    helpers = {"ANY": "@any", "ATTRIBUTE": "@attr", **names}
    # The place is part of the names, so that nested statements keep theirs apart.
    location = f"{at.lineno}.{at.col_offset}"
    _Filler(parts, blocks, helpers, location).visit(tree)
    return tree.body


class _Filler(ast.NodeTransformer):
    """Fills a template; other capital names become names that programs cannot write."""

    def __init__(
        self,
        parts: dict[str, ast.expr],
        blocks: dict[str, list[ast.stmt]],
        names: dict[str, str],
        location: str,
    ) -> None:
        self._parts = parts
        self._blocks = blocks
        self._names = names
        self._location = location

    def _name(self, name: str) -> str:
        if name in self._names:
            return self._names[name]
        return f"@{name}{self._location}" if name.isupper() else name

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id in self._parts:
            return self._parts[node.id]
        return ast.Name(self._name(node.id), node.ctx)

    def visit_ExceptHandler(self, node: ast.ExceptHandler) -> ast.AST:
        self.generic_visit(node)
        node.name = self._name(node.name) if node.name else None
        return node

    def visit_Expr(self, node: ast.Expr) -> ast.stmt | list[ast.stmt]:
        if isinstance(node.value, ast.Name) and node.value.id in self._blocks:
            # An `else` that the program does not have is an empty block.
            return self._blocks[node.value.id] or [ast.Pass()]
        self.generic_visit(node)
        return node
