"""Transformation of a hub program, so that CPython computes, formats and refuses as a hub.

Line numbers stay. The names of the helpers, in ``operators.py`` and ``attributes.py``, contain an ``@``, which no program can
write.
"""

from __future__ import annotations

import ast
import copy
from collections.abc import Collection

from brickhub.virtual.micropython.attributes import may_be_hidden
from brickhub.virtual.micropython.floats import SMALL_MAX, SMALL_MIN, read_constant
from brickhub.virtual.micropython.operators import ASCII_METHODS
from brickhub.virtual.micropython.syntax.calls import call, called_name, constant_argument
from brickhub.virtual.micropython.syntax.folding import fold
from brickhub.virtual.micropython.syntax.transform_async import async_for, async_with

_WRAPPED = (ast.Add, ast.Sub, ast.LShift)
_ARITHMETIC = {ast.Mult: "@mul", ast.Div: "@div", ast.FloorDiv: "@floordiv", ast.Mod: "@mod", ast.Pow: "@pow"}
_CALLED = {**_ARITHMETIC, ast.BitAnd: "@and", ast.BitOr: "@or", ast.BitXor: "@xor"}
_IN_PLACE = {ast.Add: "@iadd", ast.Sub: "@isub", ast.BitAnd: "@iand", ast.BitOr: "@ior", ast.BitXor: "@ixor"}
"""Operators that can change a value in place on a hub; for others ``a *= b`` is ``a = a * b``."""
_CONVERSIONS = ("int", "float", "str", "slice")
_METHODS = ("format", "to_bytes", "from_bytes", "sort", "throw", "close", *ASCII_METHODS)
_OF_ITERABLES = ("list", "tuple", "bytes")  # their helper takes one argument; others are refused as those of any function
_GENERIC = ("list", "tuple", "dict", "set", "type", "enumerate", "map", "zip", "reversed")  # have items, such as list[int]
_TAKE_MEMORY = (ast.Call, ast.List, ast.Tuple)
_EMITTERS = ("micropython.native", "micropython.viper", "micropython.bytecode")


def transform(
    tree: ast.Module | ast.Expression, recursive: Collection[str] = (), floats: Collection[str] = ()
) -> ast.Module | ast.Expression:
    """The transformed program. ``recursive``: `called_name` of functions that may call themselves. ``floats``: text of the
    compiled program's floats. Raises OverflowError if a constant needs more than 31 bits."""
    return ast.fix_missing_locations(_Transformer(recursive, floats).visit(tree))  # type: ignore[no-any-return]


class _Transformer(ast.NodeTransformer):
    def __init__(self, recursive: Collection[str], floats: Collection[str]) -> None:
        self._recursive = recursive
        self._floats = floats
        self._private: dict[str, ast.expr] = {}
        """Values of names such as ``_SPEED = const(100)``, which exist for the hub's compiler only."""
        self._globals: Collection[str] | None = None
        """Names that the function or class around declares global; ``None`` outside of them, where all are."""

    def visit_Name(self, node: ast.Name) -> ast.expr:
        is_private = node.id in self._private and isinstance(node.ctx, ast.Load)
        return copy.deepcopy(self._private[node.id]) if is_private else node

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        if type(node.value) is float:
            node.value = read_constant(node.value, self._floats)
        elif type(node.value) is int and not SMALL_MIN <= node.value <= SMALL_MAX:
            raise OverflowError("long int not supported in this build")
        return node

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.expr:
        folded = fold(node)
        if folded is not None:
            return self.visit_Constant(ast.copy_location(ast.Constant(folded), node))
        self.generic_visit(node)
        return node

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        folded = fold(node)
        if folded is not None:
            return self.visit_Constant(ast.copy_location(ast.Constant(folded), node))
        self.generic_visit(node)
        kind = type(node.op)
        if kind in _WRAPPED:
            return call("@n", node, at=node)
        if kind in _CALLED:
            return call(_CALLED[kind], node.left, node.right, at=node)
        return node

    def visit_Expr(self, node: ast.Expr) -> ast.AST:
        """The hub's compiler drops a number that stands alone, even a large one."""
        is_number = isinstance(node.value, ast.BinOp) and fold(node.value) is not None
        return ast.copy_location(ast.Pass(), node) if is_number else self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> ast.AST | list[ast.stmt]:
        self.generic_visit(node)
        kind, target = type(node.op), node.target
        if isinstance(target, ast.Name):
            read: ast.expr = ast.Name(target.id, ast.Load())
            if kind is ast.Sub or (kind is ast.Add and isinstance(node.value, ast.Constant)):
                return [node, ast.copy_location(ast.Assign([target], call("@n", read, at=node)), node)]
            return ast.copy_location(ast.Assign([target], self._operate(read, node)), node)
        statements: list[ast.stmt] = [self._assign_temporary("@owner", target.value, node)]
        owner: ast.expr = ast.Name("@owner", ast.Load())
        if isinstance(target, ast.Attribute):
            read = ast.Attribute(owner, target.attr, ast.Load())
            write: ast.expr = ast.Attribute(owner, target.attr, ast.Store())
        else:
            statements.append(self._assign_temporary("@index", target.slice, node))
            index = ast.Name("@index", ast.Load())
            read, write = ast.Subscript(owner, index, ast.Load()), ast.Subscript(owner, index, ast.Store())
        assign = ast.copy_location(ast.Assign([write], self._operate(read, node)), node)
        statements.append(self._store_statement(assign))
        return statements

    @staticmethod
    def _operate(read: ast.expr, node: ast.AugAssign) -> ast.expr:
        """The new value of the target of ``a += b``."""
        kind = type(node.op)
        if helper := _IN_PLACE.get(kind) or _ARITHMETIC.get(kind):
            return call(helper, read, node.value, at=node)
        return call("@n", ast.copy_location(ast.BinOp(read, node.op, node.value), node), at=node)

    @staticmethod
    def _store_statement(node: ast.Assign) -> ast.stmt:
        """Statement for ``owner.name = value``, which fails if the owner accepts no attributes."""
        if len(node.targets) > 1 or not isinstance(node.targets[0], ast.Attribute):
            return node
        target = node.targets[0]
        return ast.copy_location(ast.Expr(call("@store", node.value, target.value, ast.Constant(target.attr), at=node)), node)

    @staticmethod
    def _assign_temporary(name: str, value: ast.expr, at: ast.AST) -> ast.stmt:
        if isinstance(value, ast.Slice):
            bounds = [bound or ast.Constant(None) for bound in (value.lower, value.upper, value.step)]
            value = call("slice", *bounds, at=at)
        return ast.copy_location(ast.Assign([ast.Name(name, ast.Store())], value), at)

    def visit_Call(self, node: ast.Call) -> ast.expr:
        function, is_recursive = node.func, called_name(node) in self._recursive
        is_of_one = len(node.args) == 1 and not node.keywords and not isinstance(node.args[0], ast.Starred)
        methods = (*_METHODS, "extend", "join") if is_of_one and not is_recursive else _METHODS
        self.generic_visit(node)
        if isinstance(function, ast.Name) and (function.id in _CONVERSIONS or (is_of_one and function.id in _OF_ITERABLES)):
            return self._call_helper(node, function.id, function)
        if isinstance(function, ast.Attribute) and function.attr in methods:
            return self._call_helper(node, function.attr, function.value)
        if node.keywords:
            node.func = call("@keywords", node.func, at=node)
        if is_recursive:
            node.func = call("@callee", node.func, at=node)
        return node

    @staticmethod
    def _call_helper(node: ast.Call, name: str, subject: ast.expr) -> ast.Call:
        node.args.insert(0, subject)
        node.func = ast.copy_location(ast.Name("@" + name, ast.Load()), node.func)
        return node

    def visit_Starred(self, node: ast.Starred) -> ast.expr:
        """Arguments ``*values``."""
        self.generic_visit(node)
        if isinstance(node.ctx, ast.Load):
            node.value = call("@star", node.value, at=node.value)
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        self.generic_visit(node)
        if isinstance(node.ctx, ast.Load) and may_be_hidden(node.attr):
            return call("@attr", node.value, ast.Constant(node.attr), at=node)
        return node

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        self.generic_visit(node)
        s = node.slice
        if isinstance(node.value, ast.Name) and node.value.id in _GENERIC:
            node.value = call("@sub", node.value, at=node.value)
        if isinstance(node.ctx, ast.Load) and isinstance(s, ast.Slice) and s.step is not None:
            bounds = [bound or ast.Constant(None) for bound in (s.lower, s.upper, s.step)]
            return call("@stepped", node.value, *bounds, at=node)
        return node

    def visit_Assign(self, node: ast.Assign) -> ast.AST:
        target = node.targets[0]
        if len(node.targets) == 1 and isinstance(target, ast.Name):
            constant = constant_argument(node.value)
            if constant is not node.value and target.id.startswith("_"):
                self._private[target.id] = self.visit(constant)
                return ast.copy_location(ast.Pass(), node)
            node.value = constant
        self.generic_visit(node)
        if len(node.targets) == 1 and isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Slice):
            bounds = [bound or ast.Constant(None) for bound in (target.slice.lower, target.slice.upper, target.slice.step)]
            return ast.copy_location(ast.Expr(call("@setslice", node.value, target.value, *bounds, at=node)), node)
        return self._store_statement(node)

    def visit_Dict(self, node: ast.Dict) -> ast.expr:
        self.generic_visit(node)
        pairs = zip(node.values, node.keys, strict=True)
        return call("@dict", *(part for pair in pairs for part in pair if part is not None), at=node)

    def visit_Set(self, node: ast.Set) -> ast.expr:
        self.generic_visit(node)
        return call("@set", *node.elts, at=node)

    def visit_GeneratorExp(self, node: ast.GeneratorExp | ast.ListComp, branch: str = "@turn") -> ast.expr:
        """A loop: it branches after each element, and at each condition."""
        self.generic_visit(node)
        node.elt = call(branch, node.elt, at=node.elt)
        return node

    def visit_ListComp(self, node: ast.ListComp) -> ast.expr:
        """A function of its own as on a hub, which a list comprehension of CPython is no more from 3.12 on."""
        if any(isinstance(part, ast.Await) for part in ast.walk(node)):
            return self.visit_GeneratorExp(node)
        generator = ast.copy_location(ast.GeneratorExp(node.elt, node.generators), node)
        return call("@listof", self.visit_GeneratorExp(generator, "@element"), at=node)

    def visit_DictComp(self, node: ast.DictComp) -> ast.expr:
        pairs = ast.ListComp(ast.Tuple([node.value, node.key], ast.Load()), node.generators)
        return call("@dictof", self.visit_ListComp(ast.copy_location(pairs, node)), at=node)

    def visit_SetComp(self, node: ast.SetComp) -> ast.expr:
        return call("@setof", self.visit_ListComp(ast.copy_location(ast.ListComp(node.elt, node.generators), node)), at=node)

    def visit_comprehension(self, node: ast.comprehension) -> ast.comprehension:
        self.generic_visit(node)
        node.ifs = [call("@branch", test, at=test) for test in node.ifs]
        return node

    def visit_Lambda(self, node: ast.Lambda) -> ast.expr:
        self.generic_visit(node)
        if node.args.kwarg is not None:
            name = node.args.kwarg.arg
            inner = ast.Lambda(ast.arguments([], [ast.arg(name)], None, [], [], None, []), node.body)
            node.body = ast.copy_location(ast.Call(inner, [call("@named", ast.Name(name, ast.Load()), at=node)], []), node)
        return node

    @staticmethod
    def _convert_kwargs(args: ast.arguments, at: ast.AST) -> list[ast.stmt]:
        """Conversion of ``**kwargs`` to a hub's dict."""
        if args.kwarg is None:
            return []
        name = args.kwarg.arg
        value = call("@named", ast.Name(name, ast.Load()), at=at)
        return [ast.copy_location(ast.Assign([ast.Name(name, ast.Store())], value), at)]

    def visit_Delete(self, node: ast.Delete) -> list[ast.stmt]:
        self.generic_visit(node)
        statements: list[ast.stmt] = []
        for target in node.targets:
            if isinstance(target, ast.Name) and (self._globals is None or target.id in self._globals):
                delete: ast.stmt = ast.Expr(call("@del", ast.Constant(target.id), at=node))
            else:
                delete = ast.Delete([target])
            if isinstance(target, ast.Subscript) and isinstance(target.slice, ast.Slice):
                target.value = call("@sliced", target.value, target.slice.step or ast.Constant(None), at=target)
            statements.append(ast.copy_location(delete, node))
        return statements

    def visit_Compare(self, node: ast.Compare) -> ast.expr:
        self.generic_visit(node)
        left, operation, right = node.left, node.ops[0], node.comparators[0]
        is_constant = isinstance(left, ast.Constant) or (isinstance(right, ast.Constant) and isinstance(right.value, bytes))
        if len(node.ops) > 1 or not isinstance(operation, ast.In | ast.NotIn) or not is_constant:
            return node
        contains = call("@in", left, right, at=node)
        return contains if isinstance(operation, ast.In) else ast.copy_location(ast.UnaryOp(ast.Not(), contains), node)

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
            statements.append(ast.copy_location(ast.Assign([ast.Name(alias.asname, ast.Store())], value), node))
        return statements

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.expr:
        self.generic_visit(node)
        if all(isinstance(part, ast.Constant) for part in node.values):
            return node
        join = ast.Attribute(ast.Constant(""), "join", ast.Load())
        return ast.copy_location(ast.Call(join, [ast.Tuple(node.values, ast.Load())], []), node)

    def visit_FormattedValue(self, node: ast.FormattedValue) -> ast.expr:
        self.generic_visit(node)
        spec = node.format_spec or ast.Constant("")
        return call("@f", node.value, ast.Constant(node.conversion), spec, at=node)

    def visit_ExceptHandler(self, node: ast.ExceptHandler) -> ast.AST:
        """A program must not catch the exceptions that stop it from outside."""
        self.generic_visit(node)
        catches_all = node.type is None or (isinstance(node.type, ast.Name) and node.type.id == "BaseException")
        if catches_all:
            node.type = ast.copy_location(ast.Name("@any", ast.Load()), node)
        if node.name is not None:
            reword = ast.Expr(call("@reword", ast.Name(node.name, ast.Load()), at=node))
            node.body.insert(0, ast.copy_location(reword, node))
        return node

    def visit_Try(self, node: ast.Try) -> ast.AST:
        """Neither a hub that is switched off runs a ``finally``, nor a generator that is dropped."""
        self.generic_visit(node)
        if node.finalbody:
            at = node.finalbody[0]
            node.finalbody = [ast.copy_location(ast.If(call("@ends", at=at), node.finalbody, []), at)]
        return node

    def visit_With(self, node: ast.With) -> ast.AST:
        self.generic_visit(node)
        for item in node.items:
            item.context_expr = call("@with", item.context_expr, ast.Name("@reword", ast.Load()), at=item.context_expr)
        return node

    def visit_If(self, node: ast.If | ast.IfExp) -> ast.AST:
        self.generic_visit(node)
        node.test = call("@branch", node.test, at=node.test)
        return node

    visit_IfExp = visit_If

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        self.generic_visit(node)
        *first, last = node.values
        node.values = [*(call("@branch", value, at=value) for value in first), last]
        return node

    def visit_While(self, node: ast.While) -> ast.AST:
        self.generic_visit(node)
        if not isinstance(node.test, ast.Constant):
            node.test = call("@branch", node.test, at=node.test)
        node.body.insert(0, ast.copy_location(ast.Expr(call("@tick", at=node)), node))
        return node

    def visit_For(self, node: ast.For) -> ast.AST | list[ast.stmt]:
        self.generic_visit(node)
        if not any(isinstance(part, _TAKE_MEMORY) for statement in node.body for part in ast.walk(statement)):
            return node
        first = node.body[0]
        node.body.insert(0, ast.copy_location(ast.Expr(call("@turn", ast.Constant(None), at=first)), first))
        branch = ast.Expr(call("@branch", ast.Constant(None), at=node))
        return [node, ast.copy_location(branch, node)]

    def visit_arg(self, node: ast.arg) -> ast.AST:
        node.annotation = None  # the hub's compiler skips annotations, whatever names are in them
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        """An annotation without a value only makes a name local."""
        assign = ast.copy_location(ast.Assign([node.target], node.value or ast.Constant(None)), node)
        if node.value is None:
            return ast.copy_location(ast.If(ast.Constant(False), [assign], []), node)
        self.generic_visit(assign)
        return assign

    def _visit_scope(self, node: ast.stmt) -> None:
        around = self._globals
        self._globals = [name for part in ast.walk(node) if isinstance(part, ast.Global) for name in part.names]
        self.generic_visit(node)
        self._globals = around

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        """A hub ignores ``__slots__``: every object has a dictionary."""
        self._visit_scope(node)
        for statement in node.body:
            for target in statement.targets if isinstance(statement, ast.Assign) else ():
                if isinstance(target, ast.Name) and target.id == "__slots__":
                    target.id = "@slots"
        return node

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        self._strip_emitters(node)
        node.returns = None
        self._visit_scope(node)
        node.body = [*self._convert_kwargs(node.args, node), *node.body]
        return node

    def visit_AsyncFunctionDef(self, node: ast.AsyncFunctionDef) -> ast.AST:
        """On a hub a coroutine is a generator, and ``await`` is ``yield from``."""
        self._strip_emitters(node)
        self._visit_scope(node)
        never = ast.If(ast.Constant(False), [ast.Expr(ast.Yield(None))], [])
        body = [never, *self._convert_kwargs(node.args, node), *node.body]
        return ast.copy_location(ast.FunctionDef(node.name, node.args, body, node.decorator_list), node)

    def visit_AsyncFor(self, node: ast.AsyncFor) -> list[ast.stmt]:
        self.generic_visit(node)
        return async_for(node)

    def visit_AsyncWith(self, node: ast.AsyncWith) -> list[ast.stmt]:
        self.generic_visit(node)
        return async_with(node)

    def visit_Await(self, node: ast.Await) -> ast.expr:
        self.generic_visit(node)
        return ast.copy_location(ast.YieldFrom(node.value), node)

    @staticmethod
    def _strip_emitters(node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        """Remove ``@micropython.native`` and the like, which are directives to the compiler."""
        node.decorator_list = [d for d in node.decorator_list if ast.unparse(d) not in _EMITTERS]
