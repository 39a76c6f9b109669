"""A small interpreter of IEC 61131-3 Structured Text: functions, function blocks, IF, expressions.

Written from the standard's grammar, not from the export that it runs. Types are checked as a PLC's
compiler does: no implicit conversion between whole and real numbers, no undeclared names.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

TOKEN = re.compile(
    r"\s*(?:(?P<real>\d+\.\d+(?:[eE][+-]?\d+)?)|(?P<whole>\d+(?!\.\d))|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<mark>:=|<>|<=|>=|\.\.|[-+*/=<>()\[\],;:]))"
)
TYPES = {"LREAL": float, "INT": int, "DINT": int, "BOOL": bool}
LEVELS = (("OR",), ("AND",), ("=", "<>", "<", ">", "<=", ">="), ("+", "-"), ("*", "/"))
OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "OR": lambda a, b: a or b, "AND": lambda a, b: a and b, "=": lambda a, b: a == b,
    "<>": lambda a, b: a != b, "<": lambda a, b: a < b, ">": lambda a, b: a > b,
    "<=": lambda a, b: a <= b, ">=": lambda a, b: a >= b, "+": lambda a, b: a + b,
    "-": lambda a, b: a - b, "*": lambda a, b: a * b, "/": lambda a, b: a / b,
}  # fmt: skip


def _limit(low: float, value: float, high: float) -> float:
    return min(max(value, low), high)


BUILT_IN: dict[str, Callable[..., Any]] = {
    "ABS": abs, "LIMIT": _limit, "DINT_TO_LREAL": float,
    "TRUNC": lambda x: 0 if math.isnan(x) else math.trunc(x),
}  # fmt: skip


@dataclass
class Unit:
    """A function or a function block with its variables."""

    program: Program
    name: str
    types: dict[str, type] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)
    inputs: list[str] = field(default_factory=list)
    constants: set[str] = field(default_factory=set)
    body: list[Any] = field(default_factory=list)

    def __call__(self, *arguments: Any) -> Any:
        for name, value in zip(self.inputs, arguments, strict=True):
            self.assign(name, value)
        self.run(self.body)
        return self.values.get(self.name)

    def assign(self, name: str, value: Any) -> None:
        if name in self.constants or type(value) is not self.types[name]:
            raise TypeError(f"{self.name}: {name} := {value!r}")
        self.values[name] = value

    def run(self, statements: Sequence[Any]) -> None:
        for kind, *parts in statements:
            if kind == ":=":
                self.assign(parts[0], self.value(parts[1]))
            else:
                for condition, block in parts[0]:
                    if condition is None or self.value(condition):
                        self.run(block)
                        break

    def value(self, tree: Any) -> Any:
        kind, *parts = tree
        if kind == "literal":
            return parts[0]
        if kind == "name":
            return self.values[parts[0]]
        if kind == "element":
            index = self.value(parts[1])
            assert index >= 0
            return self.values[parts[0]][index]
        if kind == "call":
            called = self.program.units.get(parts[0]) or BUILT_IN[parts[0]]
            return called(*map(self.value, parts[1]))
        operands = [self.value(part) for part in parts[0]]
        if len(operands) == 1:
            return not operands[0] if kind == "NOT" else -operands[0]
        if type(operands[0]) is not type(operands[1]):
            raise TypeError(f"{self.name}: {operands[0]!r} {kind} {operands[1]!r}")
        return OPERATORS[kind](*operands)


class Program:
    """Units of a text; `units[name]` calls one."""

    def __init__(self, text: str) -> None:
        text = re.sub(r"\(\*.*?\*\)", " ", text, flags=re.DOTALL).rstrip()
        self.tokens: list[tuple[str, str]] = []
        place = 0
        while place < len(text):
            found = TOKEN.match(text, place)
            if found is None:
                raise SyntaxError(text[place : place + 40])
            self.tokens.append((str(found.lastgroup), found[str(found.lastgroup)]))
            place = found.end()
        self.units: dict[str, Unit] = {}
        self.at = 0
        while self.at < len(self.tokens):
            self._unit()

    def _next(self, *expected: str) -> str:
        word = self.tokens[self.at][1]
        if expected and word not in expected:
            raise SyntaxError(f"{word} instead of {' or '.join(expected)}")
        self.at += 1
        return word

    def _is(self, *words: str) -> bool:
        return self.tokens[self.at][1] in words

    def _unit(self) -> None:
        kind = self._next("FUNCTION", "FUNCTION_BLOCK")
        unit = Unit(self, self._next())
        if kind == "FUNCTION":
            self._next(":")
            unit.types[unit.name] = TYPES[self._next()]
        while self._is("VAR", "VAR_INPUT", "VAR_OUTPUT"):
            self._variables(unit)
        unit.body = self._statements(f"END_{kind}")
        self._next(f"END_{kind}")
        self.units[unit.name] = unit

    def _variables(self, unit: Unit) -> None:
        section = self._next()
        constant = self._is("CONSTANT") and bool(self._next())
        while not self._is("END_VAR"):
            name = self._next()
            self._next(":")
            if self._is("ARRAY"):
                for word in ("ARRAY", "[", "0", ".."):
                    self._next(word)
                last = int(self._next())
                for word in ("]", "OF", "LREAL", ":=", "["):
                    self._next(word)
                cells = [self._constant(unit)]
                while self._next(",", "]") == ",":
                    cells.append(self._constant(unit))
                assert len(cells) == last + 1
                unit.values[name] = cells
            else:
                unit.types[name] = TYPES[self._next()]
                unit.values[name] = unit.types[name]()
                if self._is(":="):
                    self._next()
                    unit.assign(name, self._constant(unit))
            self._next(";")
            unit.inputs += [name] if section == "VAR_INPUT" else []
            unit.constants |= {name} if constant else set()
        self._next("END_VAR")

    def _constant(self, unit: Unit) -> Any:
        return unit.value(self._expression())

    def _statements(self, *ends: str) -> list[Any]:
        found: list[Any] = []
        while not self._is(*ends):
            if self._is("IF"):
                found.append(("IF", self._choices()))
            else:
                name = self._next()
                self._next(":=")
                found.append((":=", name, self._expression()))
            self._next(";")
        return found

    def _choices(self) -> list[Any]:
        choices: list[Any] = []
        word = self._next("IF")
        while word != "END_IF":
            condition = None
            if word != "ELSE":
                condition = self._expression()
                self._next("THEN")
            choices.append((condition, self._statements("ELSIF", "ELSE", "END_IF")))
            word = self._next()
        return choices

    def _expression(self, level: int = 0) -> Any:
        if level == len(LEVELS):
            return self._operand()
        left = self._expression(level + 1)
        while self._is(*LEVELS[level]):
            operator = self._next()
            left = (operator, (left, self._expression(level + 1)))
        return left

    def _operand(self) -> Any:
        kind, word = self.tokens[self.at]
        self.at += 1
        if word in ("-", "NOT"):
            return (word, (self._operand(),))
        if word == "(":
            inner = self._expression()
            self._next(")")
            return inner
        if word in ("TRUE", "FALSE"):
            return ("literal", word == "TRUE")
        if kind in ("real", "whole"):
            return ("literal", float(word) if kind == "real" else int(word))
        if kind != "name":
            raise SyntaxError(word)
        if self.at < len(self.tokens) and self._is("["):
            self._next()
            index = self._expression()
            self._next("]")
            return ("element", word, index)
        if self.at < len(self.tokens) and self._is("("):
            self._next()
            arguments = [self._expression()]
            while self._next(",", ")") == ",":
                arguments.append(self._expression())
            return ("call", word, arguments)
        return ("name", word)
