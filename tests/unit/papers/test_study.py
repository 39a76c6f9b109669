"""The chains of the study, and what it says of models on them."""

from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from tests.support.draws import some

from torquebench.papers.page import study_blocks
from torquebench.papers.study import (
    CHAINS,
    CLAIMED_RATIO,
    FAMILIES,
    Contender,
    Finding,
    Row,
    Study,
    best_quadratic_nm,
    contenders,
    errors_of,
    studied_chain,
    study_tasks,
    summarised,
    task_findings,
)

HYBRID = Contender("hybrid", "physics + Gaussian process")
POLYNOMIAL = contenders(())[0]


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("seed", [0, 7])
def test_the_best_quadratic_leaves_four_newton_metres(family: str, seed: int) -> None:
    assert best_quadratic_nm(studied_chain(family, seed)) == pytest.approx(4.0, abs=0.01)


@pytest.mark.parametrize("family", some(FAMILIES, by_day=1))
def test_a_chain_of_either_sign_is_compensated_equally_well(family: str) -> None:
    chain = studied_chain(family, 2)
    turned = replace(chain, scale_nm=-chain.scale_nm)
    models = (POLYNOMIAL, HYBRID)
    for one, other in zip(
        errors_of(chain, "200 up and down", models),
        errors_of(turned, "200 up and down", models),
        strict=True,
    ):
        assert one.worst_nm / other.worst_nm == pytest.approx(1.0, abs=0.35), one.title
    assert errors_of(turned, "200 up and down", [HYBRID])[0].worst_nm < 1.0


def test_mapping_and_start_decide_whether_the_network_beats_the_polynomial() -> None:
    names = {each.title: each for each in contenders((50_000,), others=False)}
    found = task_findings(("smooth", "50 rising", 0), tuple(names.values()))
    rows = {row.title: row for row in summarised(found)}
    good = rows["BP, additional torque, small start, 50000 epochs"]
    assert good.beats == good.chains == 1
    assert good.worst_nm < 1.8
    for title in (
        "BP, standard torque, small start, 50000 epochs",
        "BP, additional torque, Nguyen-Widrow, 50000 epochs",
        "BP, standard torque, Nguyen-Widrow, 50000 epochs",
    ):
        assert rows[title].beats == 0, title
        assert rows[title].ratio < 1.0, title


@pytest.fixture
def workers() -> Iterator[Executor]:
    with ThreadPoolExecutor(1) as pool:
        yield pool


def test_an_interrupted_study_goes_on_where_it_was(workers: Executor, tmp_path: Path) -> None:
    file = tmp_path / "page.study"
    tasks = study_tasks(range(3), ("50 rising", ["smooth", "rippled"]))
    first = Study(tasks[:4], (POLYNOMIAL,), workers, file).rows()
    with file.open("a") as torn:
        torn.write('[["rippled", "50 ri')
    submitted = []

    class Counting(Executor):
        def submit(self, function, /, *args):  # type: ignore[no-untyped-def]
            submitted.append(args[0])
            return workers.submit(function, *args)

    rows = Study(tasks, (POLYNOMIAL,), Counting(), file).rows()
    assert submitted == list(tasks[4:])
    assert rows[0] == first[0]
    assert [row.chains for row in rows] == [3, 3]
    assert rows == Study(tasks, (POLYNOMIAL,), workers).rows()
    # Other models are another study.
    submitted.clear()
    Study(tasks[:1], (POLYNOMIAL, HYBRID), Counting(), file).rows()
    assert submitted == [tasks[0]]


def test_trainings_of_one_start_share_their_way_and_end_as_if_alone() -> None:
    chosen = [each for each in contenders((500, 2_000), (300.0,)) if "small" in each.title]
    chain = studied_chain("reversing", 1)
    together = errors_of(chain, "50 rising", chosen)
    assert together == [errors_of(chain, "50 rising", [each])[0] for each in chosen]
    assert len({each.worst_nm for each in together}) == len(together)


def test_rows_count_chains_and_take_medians() -> None:
    def found(title: str, seed: int, worst: float) -> Finding:
        return Finding("smooth", "50 rising", title, seed, worst, worst)

    rows = summarised(
        [found("polynomial, degree 2", seed, 4.0) for seed in range(3)]
        + [found("BP", seed, worst) for seed, worst in enumerate((1.0, 2.0, 1.7))]
    )
    assert rows[0].ratio == 1.0
    assert rows[1].worst_nm == 1.7
    assert rows[1].beats == rows[1].below == 2
    assert CLAIMED_RATIO == 4.0 / 1.8


def test_the_finding_says_on_which_chains_a_variant_holds() -> None:
    def row(family: str, title: str, ratio: float, beats: int) -> Row:
        return Row(family, "50 rising", title, 1.0, 1.0, ratio, beats, 0, CHAINS)

    rows = [
        row(family, title, ratio, beats)
        for family, beats in (("smooth", 20), ("rippled", 1))
        for title, ratio in (("polynomial, degree 2", 1.0), ("BP, small start", 3.0))
    ]
    answer, tables = study_blocks(rows, CHAINS)
    assert "smooth, 50 rising: BP, small start; rippled, 50 rising: none" in answer.ours
    assert answer.verdict == "partly"
    assert "--quick" not in answer.why
    assert "2 chains are few" in study_blocks(rows, 2)[0].why
    header, *lines = [tables[0].header, *tables[0].rows]  # type: ignore[union-attr]
    assert list(header) == ["model", "smooth, 50 rising", "rippled, 50 rising"]
    assert lines[1] == ["BP, small start", "3.00 (20)", "3.00 (1)"]
