"""What the core says in English is known on the Chinese panel, and nothing known is made up."""

import ast
import re
import tomllib
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields
from functools import cache
from pathlib import Path
from string import Formatter

import numpy as np
import pytest

import torquebench
from torquebench.bench.safety import AlarmKind
from torquebench.calibration import load_profile
from torquebench.campaign.fitting import model_title
from torquebench.campaign.reducers.catalogue import TESTS
from torquebench.compensation import MODELS
from torquebench.errors import InputError
from torquebench.figures import group_figure, translated_labels
from torquebench.message import Message
from torquebench.operations import OPERATIONS, Parameter, parameters
from torquebench.operations.result import Result
from torquebench.panel.text import Text
from torquebench.panel.text.catalogue import LABEL_PARTS
from torquebench.reports.certificate.building import UNREVIEWED
from torquebench.signals import SignalFaultKind
from torquebench.translations import has_words, templates, translated
from torquebench.uncertainty import Verdict
from torquebench.units import title_of_name, unit_of_name

ROOT = Path(torquebench.__file__).parent
HOLE = re.compile(r"\{(\w+)\}")
PARTS = {
    *("Curve", "Diagram", "Facts", "Figure", "Page", "Panel", "Section", "Table"),
    *("Answer", "Item"),
}
"""What pages of results are made of."""
ENGLISH_PAGES = {"reports/demo_report.py", "reports/module_report.py"}
"""Pages of `demo`, which only the command line writes."""
NOT_ON_THE_PANEL = (
    "cli/",
    "client.py",
    "notebook/",
    "simulators/",
    "twin/",
)
"""Packages whose messages no page of the panel shows."""
SAID_BY = re.compile(
    r"(Error|Fault|Violation|_violated|Contradiction|Refusal|Finding|_deviation|_over|JobResult"
    r"|Finished|trip|ask|start|finish|_refuse|_refuse_busy|progress)$"
)
"""Functions and classes whose constant arguments are messages without values."""


def key(template: str) -> str:
    """Return the template without format specifications, as a message has it."""
    return "".join(
        literal.replace("{", "{{").replace("}", "}}") + (f"{{{name}}}" if name else "")
        for literal, name, _, _ in Formatter().parse(template)
    )


def constants(node: ast.AST) -> Iterator[str]:
    """Yield the text of an argument: one constant, or one of several."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    for each in (
        (node.body, node.orelse)
        if isinstance(node, ast.IfExp)
        else node.values
        if isinstance(node, ast.BoolOp)
        else node.elts
        if isinstance(node, ast.Tuple)
        else ()
    ):
        yield from constants(each)


@cache
def trees() -> dict[str, ast.Module]:
    return {
        file.relative_to(ROOT).as_posix(): ast.parse(file.read_text(encoding="utf-8"))
        for file in ROOT.rglob("*.py")
    }


@cache
def errors() -> frozenset[str]:
    """Return the names of all errors, whichever modules are imported."""
    bases = {
        node.name: {ast.unparse(base).rpartition(".")[2] for base in node.bases}
        for tree in trees().values()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    }
    found = {"TorquebenchError"}
    while more := {name for name, of in bases.items() if of & found} - found:
        found |= more
    return frozenset(found)


@cache
def calls(path: str) -> tuple[tuple[str, ast.Call], ...]:
    """Return a module's calls, each with the name of what it calls."""
    return tuple(
        (ast.unparse(node.func), node)
        for node in ast.walk(trees()[path])
        if isinstance(node, ast.Call)
    )


def messages(path: str) -> Iterator[str]:
    """Yield the templates of a module, and its messages without values."""
    for name, call in calls(path):
        if name == "Message":
            yield from map(key, constants(call.args[0]))
        elif name.endswith("._level"):  # its template is filled only where it is shown
            yield from (key(each) for value in call.args for each in constants(value))
        elif SAID_BY.search(name):
            for value in (*call.args, *(keyword.value for keyword in call.keywords)):
                yield from (each for each in constants(value) if " " in each)


def panel_texts(path: str) -> Iterator[str]:
    """Yield the English texts that a module of the panel passes on to `Text`."""
    for name, call in calls(path):
        if re.search(r"(^|[._])text$|^Text\(", name) and call.args:
            yield from constants(call.args[0])
        elif name == "headings":
            yield from (each for value in call.args for each in constants(value))
        elif name == "page" and len(call.args) > 2:
            yield from constants(call.args[2])
    for node in ast.walk(trees()[path]):
        if isinstance(node, ast.AnnAssign) and ast.unparse(node.annotation) == "Texts":
            assert isinstance(node.value, ast.Dict)
            yield from (each for value in node.value.values for each in constants(value))


def known(said: str) -> bool:
    return translated(said, "zh") != said


def test_every_message_that_the_panel_can_show_has_a_translation() -> None:
    known_ones = templates("zh")
    lacking = {
        said: path
        for path in trees()
        if not path.startswith(NOT_ON_THE_PANEL)
        for said in messages(path)
        if has_words(said) and said not in known_ones and said not in OPERATIONS
    }
    assert lacking == {}


def test_what_the_panel_says_is_chinese_and_has_the_same_placeholders() -> None:
    chinese = templates("zh")
    pages = [path for path in trees() if path.startswith("panel/")]
    said = {each for path in pages for each in panel_texts(path) if has_words(each)}
    assert len(said) > 700
    wrong = [
        each
        for each in said
        if not re.search(r"[\u4e00-\u9fff]", chinese.get(each, ""))
        or set(HOLE.findall(each)) != set(HOLE.findall(chinese[each]))
    ]
    assert sorted(wrong) == ["CSV"]


def page_texts(path: str) -> Iterator[str]:
    """Yield the texts in the parts of results' pages; an f-string with words as its source."""
    for name, call in calls(path):
        if name.rpartition(".")[2] in PARTS:
            yield from _texts_in(*call.args, *call.keywords)


def _texts_in(*nodes: ast.AST) -> Iterator[str]:
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            texts = [each.value for each in node.values if isinstance(each, ast.Constant)]
            yield from [ast.unparse(node)] * any(map(has_words, map(str, texts)))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
        elif isinstance(node, ast.Subscript):
            yield from _texts_in(node.value)
        elif isinstance(node, ast.keyword) and node.arg in ("style", "logarithmic"):
            continue
        elif not (isinstance(node, ast.Call) and ast.unparse(node.func) == "Message"):
            yield from _texts_in(*ast.iter_child_nodes(node))


def test_every_text_of_a_result_page_is_in_chinese() -> None:
    lacking = {
        text: path
        for path in trees()
        if path.startswith(("campaign/", "operations/", "reports/", "papers/"))
        and path not in ENGLISH_PAGES
        for text in page_texts(path)
        if has_words(text) and text not in templates("zh")
        if not text.startswith("torquebench ")
    }
    assert lacking == {}


def drawn_labels(path: str) -> Iterator[str]:
    """Yield the labels of a module's drawings, with 0 for values in them."""
    for name, call in calls(path):
        labels = [each.value for each in call.keywords if each.arg == "label"]
        if re.search(r"\.(set_(xlabel|ylabel|title)|annotate)$", name):
            labels += call.args[:1]
        for node in labels:
            if isinstance(node, ast.JoinedStr):
                parts = [each.value for each in node.values if isinstance(each, ast.Constant)]
                yield "0".join(["", *map(str, parts), ""])
            yield from constants(node)


def parts(label: str) -> list[str]:
    return [each for each in LABEL_PARTS.split(label) if has_words(each)]


def test_every_label_of_a_drawing_is_in_chinese() -> None:
    drawing = ("figures.py", "campaign/", "reports/")
    labels = {
        label
        for path in trees()
        if path.startswith(drawing) and path not in ENGLISH_PAGES
        for label in drawn_labels(path)
        if has_words(label)
    }
    assert len(labels) > 25
    lacking = {each for each in labels if not (known(each) or all(map(known, parts(each))))}
    assert lacking == set()


def test_a_drawing_is_made_in_chinese() -> None:
    with translated_labels(Text("zh").label):
        drawn = group_figure({"raw": np.ones(3)}, 100.0)
    assert "验证组" in drawn
    assert not re.search("[a-z]{3,} ?</text>", drawn)


def described(asked: Parameter) -> Iterator[str]:
    """Yield the texts of a form's field, and of the fields of a record in it."""
    yield from (asked.title, asked.help, *(unit for unit in [asked.unit] if " " in unit))
    if unit_of_name(next(iter(asked.choices), "")) == "":
        yield from asked.choices
    for part in parameters(asked.record) if asked.record else ():
        yield from described(part)


def operation_texts() -> set[str]:
    """Return what forms say: an operation's paragraphs, and its fields' titles and help."""
    return {
        text
        for operation in OPERATIONS.values()
        if operation.served
        for texts in (
            *operation.paragraphs,
            *(tuple(described(each)) for each in parameters(operation.request) if not each.local),
        )
        for text in ((texts,) if isinstance(texts, str) else texts)
        if has_words(text)
    }


def value_titles() -> set[str]:
    """Return the titles of the values of results that have no page of their own."""
    common = {each.name for each in fields(Result)}
    return {
        title_of_name(each.name)
        for operation in OPERATIONS.values()
        if operation.served and operation.result.page is Result.page
        for each in fields(operation.result)
        if each.name not in common
    }


def test_every_form_of_an_operation_is_in_chinese() -> None:
    assert {text for text in operation_texts() if not known(text)} == set()


def test_every_title_of_a_value_and_condition_of_a_certificate_is_in_chinese() -> None:
    said = {*value_titles(), *UNREVIEWED.values()}
    assert {text for text in said if not known(text)} == set()


def test_every_deviation_has_its_german_sentence_for_certificates() -> None:
    said = {
        key(text)
        for name, call in calls("calibration/deviations.py")
        if name == "_deviation"
        for node in ast.walk(call)
        for text in constants(node)
        if has_words(text) and " " in text
    }
    assert len(said) >= 18
    assert [each for each in said if each not in templates("de")] == []


def test_every_translated_message_is_in_the_source() -> None:
    said = {
        node.value
        for tree in trees().values()
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    said |= {each for path in trees() for each in messages(path)}
    said |= {part for path in trees() for label in drawn_labels(path) for part in parts(label)}
    said |= {verdict.label for verdict in Verdict} | operation_texts() | value_titles()
    described = "".join(
        file.read_text(encoding="utf-8")
        for file in ROOT.rglob("*.toml")
        if file.parent.name not in ("zh", "de") and "zh" not in file.stem
    )
    stale = [
        english
        for file in ROOT.glob("translations/*/*.toml")
        for section in tomllib.loads(file.read_text(encoding="utf-8")).values()
        for english in section
        if english not in said and english not in described
    ]
    assert stale == []


def finished_sentence(part: ast.AST) -> bool:
    """Return whether an expression puts text together without a template."""
    if isinstance(part, ast.Call):
        return ast.unparse(part.func).endswith((".format", ".format_map"))
    if isinstance(part, ast.IfExp):
        return finished_sentence(part.body) or finished_sentence(part.orelse)
    if isinstance(part, ast.BoolOp):
        return any(map(finished_sentence, part.values))
    return isinstance(part, ast.JoinedStr | ast.BinOp)


def finished_names(path: str) -> Iterator[tuple[ast.AST, str]]:
    """Yield each name that a function gives such text, with the function."""
    for function in ast.walk(trees()[path]):
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef):
            for node in ast.walk(function):
                if isinstance(node, ast.Assign | ast.AugAssign) and (
                    finished_sentence(node.value)
                    and any(isinstance(each, ast.JoinedStr) for each in ast.walk(node.value))
                ):
                    targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                    yield from ((function, each.id) for each in targets if hasattr(each, "id"))


def test_no_error_alarm_or_result_is_made_of_a_finished_sentence() -> None:
    """An f-string, a format call or a sum has no template: a `Message` has."""
    says = errors() | {"trip", "ask", "Violation", "_violated", "Refusal", "Finished", "JobResult"}
    wrong = []
    for path in trees():
        made = [
            (call, part)
            for name, call in calls(path)
            if name.rpartition(".")[2] in says
            for part in (*call.args, *(keyword.value for keyword in call.keywords))
        ]
        if not made:
            continue
        wrong += [(path, ast.unparse(part)) for _, part in made if finished_sentence(part)]
        for function, name in finished_names(path):
            inside = set(ast.walk(function))
            wrong += [
                (path, name)
                for call, part in made
                if call in inside and isinstance(part, ast.Name) and part.id == name
            ]
    assert wrong == []


@pytest.mark.parametrize("language", ["en", "de", "zh"])
def test_no_template_is_translated_twice(language: str) -> None:
    files = sorted((ROOT / "translations" / language).glob("*.toml"))
    sections = [
        section
        for file in files
        for section in tomllib.loads(file.read_text(encoding="utf-8")).values()
    ]
    found = Counter(english for section in sections for english in section)
    assert [english for english, count in found.items() if count > 1] == []


def test_every_message_has_a_value_for_each_placeholder() -> None:
    wrong = []
    for path in trees():
        for name, call in calls(path):
            if name != "Message" or any(isinstance(each, ast.Starred) for each in call.args):
                continue
            for template in constants(call.args[0]):
                names = dict.fromkeys(re.findall(r"(?<!\{)\{(\w+)", template.replace("{{", "")))
                if len(names) != len(call.args) - 1:
                    wrong.append(f"{path}:{call.lineno}: {template}")
    assert wrong == []


@pytest.mark.parametrize(
    ("said", "chinese"),
    [
        (Message("no heartbeat of the {name} for {seconds:.1f} s", "run engine", 2.34),
         "运行引擎已有 2.3 s 没有心跳"),
        (Message("mode {mode!r}", "free"), "模式 “自由”"),
        (Message.joined(["torque ripple", "few loops"], "; "), "扭矩波动；回线太少"),
        (InputError("a name", "a new name").args[0], "名称；允许：新的名称"),
        (Message("Capability: {title}", Message("{what}, of {asked}", "backlash", "RV-40E")),
         "Capability: backlash, of RV-40E"),
    ],
)  # fmt: skip
def test_a_message_is_translated_with_its_values_or_not_at_all(said: str, chinese: str) -> None:
    assert translated(said, "zh") == chinese


def test_names_that_the_core_gives_are_said_in_chinese() -> None:
    named = [kind.value for kind in AlarmKind]
    named += [kind.description for kind in SignalFaultKind]
    named += [kind.remedy for kind in SignalFaultKind if kind.remedy]
    named += [model_title(kind) for kind in ({*MODELS} - {"polynomial"}) | {"polynomial-3", "raw"}]
    profiles = (ROOT / "calibration" / "profiles").glob("*.toml")
    named += [load_profile(file.stem).title for file in profiles]
    named += [test.title for test in TESTS.values()]
    assert [said for said in named if not known(said)] == []


@pytest.mark.parametrize("language", ["de", "zh"])
def test_a_translation_names_no_value_that_its_message_lacks(language: str) -> None:
    wrong = [
        translation
        for english, translation in templates(language).items()
        if not set(HOLE.findall(translation)) <= set(HOLE.findall(english))
    ]
    assert wrong == []


def test_key_points_of_a_loop_are_named_in_chinese() -> None:
    for end in ("lower", "upper"):
        assert known(f"stiffness, {end} end")
