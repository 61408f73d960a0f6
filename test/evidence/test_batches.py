import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_evidence import NAMES, masks, problem, random_model

from gda_tracker.evidence.batches import (
    combine_grid,
    combine_rows,
    discount_columns,
    history_table,
    rule_table,
)
from gda_tracker.evidence.combination import (
    RULES,
    NothingAliveError,
    TotalConflictError,
    combine,
    discount,
    reduce_source,
)
from gda_tracker.evidence.decisions import project
from gda_tracker.evidence.destinations import destinations
from gda_tracker.evidence.frames import (
    constrained_model,
    free_element,
    free_model,
    hyper_power_set,
    shafer_model,
    singletons,
    total_ignorance,
)

seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 4)


def measured(size):
    focal = dict.fromkeys([*singletons(size), total_ignorance(size)])
    return np.array(list(focal), dtype=np.uint32)


def rows_of(random, columns, rows):
    """Masses with gaps: some columns have none in some rows."""
    masses = random.dirichlet(np.ones(len(columns)), rows)
    masses *= random.random(masses.shape) < 0.7
    masses[:, -1] += 1.0 - masses.sum(axis=1)
    return masses


def elements(random, size, model, rule, most):
    """Distinct columns, alive ones where the rule has no place for dead ones."""
    focal = hyper_power_set(size)
    if rule in ("dubois_prade", "disjunctive"):
        focal = focal[(focal & np.uint32(model.alive)) != 0]
    return random.permutation(focal)[: random.integers(1, most + 1)]


def assert_row(table, masses, conflict, rule, model, sources):
    """A row is what the calculator says, by elements of the free model."""
    try:
        fused = combine(rule, model, sources)
    except TotalConflictError:
        assert rule == "dempster"
        return
    expected = fused.masses
    if rule != "dsmc":
        expected = {free_element(model, mask): mass for mask, mass in expected.items()}
    found = dict(zip(table.focal.tolist(), masses.tolist(), strict=True))
    assert expected.keys() <= found.keys()
    for mask, mass in found.items():
        assert mass == pytest.approx(expected.get(mask, 0.0), abs=1e-14)
    assert conflict == pytest.approx(fused.conflict, abs=1e-14)


@settings(deadline=None, max_examples=80)
@given(seeds, sizes, st.sampled_from(RULES), st.integers(1, 4))
def test_rows_are_what_the_calculator_says(seed, size, rule, count):
    random = np.random.default_rng(seed)
    model = random_model(size, random)
    columns = [elements(random, size, model, rule, 5) for _ in range(count)]
    sources = [rows_of(random, focal, 3) for focal in columns]
    if rule == "dempster":  # no total conflict
        columns = [np.append(focal, np.uint32(total_ignorance(size))) for focal in columns]
        sources = [np.hstack([0.9 * source, np.full((3, 1), 0.1)]) for source in sources]
    table = rule_table(rule, model, columns)
    masses, conflict = combine_rows(table, sources)
    np.testing.assert_allclose(masses.sum(axis=1), 1.0, atol=1e-12)
    for row in range(3):
        body = []
        for focal, source in zip(columns, sources, strict=True):
            body.append(dict.fromkeys(focal.tolist(), 0.0))
            for mask, mass in zip(focal.tolist(), source[row].tolist(), strict=True):
                body[-1][mask] += mass
        assert_row(table, masses[row], conflict[row], rule, model, body)


@settings(deadline=None, max_examples=60)
@given(seeds, sizes, st.sampled_from(RULES))
def test_a_grid_is_rows_of_all_pairs(seed, size, rule):
    random = np.random.default_rng(seed)
    model = random_model(size, random)
    columns = [elements(random, size, model, rule, 20), elements(random, size, model, rule, 20)]
    if rule == "dempster":
        columns[0][0] = columns[1][0] = total_ignorance(size)
    first, second = (random.dirichlet(np.ones(len(focal)), 6) for focal in columns)
    table = rule_table(rule, model, columns)
    grid, conflict = combine_grid(table, first, second[:5])
    i, j = np.repeat(np.arange(6), 5), np.tile(np.arange(5), 6)
    masses, k = combine_rows(table, [first[i], second[j]])
    assert grid.shape == (6, 5, len(table.focal))
    np.testing.assert_allclose(grid.reshape(30, -1), masses, atol=1e-14)
    np.testing.assert_allclose(conflict.ravel(), k, atol=1e-14)


@pytest.mark.parametrize("count", [0, 1, 400])
def test_rows_over_many_columns_are_rows_of_the_grid(count):
    """Beyond some columns rows go another way, block by block; 400 are more than one."""
    random = np.random.default_rng(count)
    focal = hyper_power_set(4)
    measured = np.array([*singletons(4), total_ignorance(4)], dtype=np.uint32)
    table = rule_table("dsmc", free_model(NAMES), [focal, measured])
    assert isinstance(table.contraction, np.ndarray)
    assert table.row_contraction is not None
    first, second = random.dirichlet(np.ones(166), 4), random.dirichlet(np.ones(5), 3)
    i, j = random.integers(4, size=count), random.integers(3, size=count)
    masses, conflict = combine_rows(table, [first[i], second[j]])
    grid, expected = combine_grid(table, first, second)
    np.testing.assert_allclose(masses, grid[i, j], atol=1e-15)
    np.testing.assert_allclose(conflict, expected[i, j], atol=1e-15)
    assert masses.flags.c_contiguous


@pytest.mark.parametrize("rule", ["dsmc", "dsmh", "dempster", "pcr5", "yager"])
def test_large_tables_are_sparse_and_say_the_same(rule):
    # 166 x 166 elements: only the ones of the table are kept.
    random, names = np.random.default_rng(4), NAMES
    model = constrained_model(names, ["A&B"])
    focal = hyper_power_set(4)
    table = rule_table(rule, model, [focal, focal])
    assert not isinstance(table.contraction, np.ndarray)
    first, second = random.dirichlet(np.ones(166), 3), random.dirichlet(np.ones(166), 2)
    grid, conflict = combine_grid(table, first, second)
    for i, j in ((0, 0), (2, 1)):
        rows, k = combine_rows(table, [first[i : i + 1], second[j : j + 1]])
        np.testing.assert_allclose(grid[i, j], rows[0], atol=1e-14)
        sources = [
            dict(zip(focal.tolist(), m.tolist(), strict=True)) for m in (first[i], second[j])
        ]
        assert_row(table, rows[0], k[0], rule, model, sources)
        assert conflict[i, j] == pytest.approx(k[0], abs=1e-14)


@settings(deadline=None, max_examples=40)
@given(seeds, sizes, st.sampled_from(RULES))
def test_columns_of_a_history_stay(seed, size, rule):
    random = np.random.default_rng(seed)
    model = random_model(size, random)
    history = elements(random, size, model, rule, 4)
    table, embedding = history_table(rule, model, history, measured(size))
    assert table.ignorance >= 0
    again, same = history_table(rule, model, table.focal, measured(size))
    assert same is None
    assert again is table
    masses = random.dirichlet(np.ones(len(history)), 4)
    if embedding is not None:
        masses = masses @ embedding
    known = np.flatnonzero([mask & model.alive for mask in measured(size).tolist()])
    for _ in range(3):
        np.testing.assert_allclose(masses.sum(axis=1), 1.0, atol=1e-12)
        measurement = np.zeros((4, len(measured(size))))
        measurement[:, known] = random.dirichlet(np.ones(len(known)), 4)
        fused, conflict = combine_rows(table, [masses, measurement])
        for row in range(4):
            sources = [
                dict(zip(table.focal.tolist(), masses[row].tolist(), strict=True)),
                dict(zip(measured(size).tolist(), measurement[row].tolist(), strict=True)),
            ]
            assert_row(table, fused[row], conflict[row], rule, model, sources)
        masses = fused


def test_histories_of_another_model_are_projected():
    names = ("A", "B")
    history = np.array([0b101, 0b100], dtype=np.uint32)
    masses = np.array([[0.4, 0.6]])
    table, embedding = history_table("pcr5", shafer_model(names), history, measured(2))
    assert table.focal.tolist() == [0b101, 0b110, 0b111]
    np.testing.assert_array_equal(masses @ embedding, [[0.4, 0.0, 0.6]])
    np.testing.assert_array_equal(project(shafer_model(names), history, masses)[1], [[0.4, 0.6]])
    # Under the classic rule nothing is moved.
    table, embedding = history_table("dsmc", shafer_model(names), history, measured(2))
    assert table.focal.tolist() == [0b101, 0b110, 0b100, 0b111]
    np.testing.assert_array_equal(masses @ embedding, [[0.4, 0.0, 0.6, 0.0]])


def test_total_conflict():
    model = shafer_model(("A", "B"))
    table, _ = history_table("dempster", model, measured(2)[:2], measured(2))
    history = np.array([[1.0, 0.0, 0.0], [0.5, 0.0, 0.5], [0.0, 1.0, 0.0]])
    measurement = np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    with pytest.raises(TotalConflictError, match=r"rows \[\[0\], \[2\]\]"):
        combine_rows(table, [history, measurement])
    with pytest.raises(TotalConflictError, match=r"rows \[\[0, 0\], \[2, 1\]\]"):
        combine_grid(table, history, measurement[1:])
    masses, conflict = combine_rows(table, [history, measurement], keep_first=True)
    np.testing.assert_array_equal(masses, [[1, 0, 0], [0, 1, 0], [0, 1, 0]])
    np.testing.assert_array_equal(conflict, [1.0, 0.5, 1.0])
    grid, conflict = combine_grid(table, history, measurement, keep_first=True)
    np.testing.assert_array_equal(grid[0], [[1, 0, 0], [1, 0, 0], [1, 0, 0]])
    np.testing.assert_array_equal(conflict[0], [1.0, 1.0, 0.0])
    other = rule_table("dempster", model, [measured(2)[1::-1], measured(2)])
    with pytest.raises(ValueError, match="keep_first: allowed with a table of history_table"):
        combine_rows(other, [history[:, :2], measurement], keep_first=True)


@pytest.mark.parametrize("rule", ["dubois_prade", "disjunctive"])
def test_mass_without_a_place_is_refused(rule):
    model = shafer_model(("A", "B"))
    columns = [np.array([0b100, 0b101], dtype=np.uint32)] * 2
    table = rule_table(rule, model, columns)
    dead, alive = np.array([[0.5, 0.5]]), np.array([[0.0, 1.0]])
    for kernel in (
        lambda a, b: combine_rows(table, [a, b]),
        lambda a, b: combine_grid(table, a, b),
    ):
        with pytest.raises(NothingAliveError, match=f"rule '{rule}' has no place"):
            kernel(dead, dead)
        assert kernel(dead, alive)[0].ravel() == pytest.approx([1.0])


def test_no_rows():
    table = rule_table("pcr6", shafer_model(NAMES[:3]), [measured(3)] * 3)
    masses, conflict = combine_rows(table, [np.zeros((0, 4))] * 3)
    assert masses.shape == (0, len(table.focal))
    assert conflict.shape == (0,)
    table = rule_table("pcr5", shafer_model(NAMES[:3]), [measured(3)] * 2)
    assert combine_grid(table, np.zeros((0, 4)), np.ones((2, 4)))[0].shape == (0, 2, 4)


def test_underflow_of_shares_loses_nothing_but_itself():
    table = rule_table("pcr5", shafer_model(("A", "B")), [measured(2)] * 3)
    tiny = 1e-300
    sources = [np.array([[1 - tiny, tiny, 0.0]]), np.array([[tiny, 1.0, 0.0]])] * 2
    masses, _ = combine_rows(table, sources[:3])
    assert np.isfinite(masses).all()
    assert masses.sum() == pytest.approx(1.0)


def test_arrays_that_do_not_fit_are_named():
    table = rule_table("dsmc", free_model(("A", "B")), [measured(2)] * 2)
    with pytest.raises(ValueError, match=r"shapes \(1, 3\), \(1, 2\): allowed are rows of 3, 3"):
        combine_rows(table, [np.ones((1, 3)), np.ones((1, 2))])
    with pytest.raises(ValueError, match="sources of 1, 2 rows: allowed is one number"):
        combine_rows(table, [np.ones((1, 3)), np.ones((2, 3))])
    three = rule_table("dsmc", free_model(("A", "B")), [measured(2)] * 3)
    with pytest.raises(ValueError, match="a table of 3 sources: allowed is one of two"):
        combine_grid(three, np.ones((1, 3)), np.ones((1, 3)))
    with pytest.raises(ValueError, match="rule = 'bayes'"):
        rule_table("bayes", free_model(("A", "B")), [measured(2)])
    with pytest.raises(ValueError, match="no sources"):
        rule_table("dsmc", free_model(("A", "B")), [])


def test_five_elements_where_memory_allows():
    names = ("A", "B", "C", "D", "E")
    full = hyper_power_set(5)
    table = rule_table("dsmc", free_model(names), [full, measured(5)])
    assert len(table.focal) == 7579
    random = np.random.default_rng(3)
    few = random.choice(7579, 6, replace=False)
    history = np.zeros((2, 7579))
    history[:, few] = random.dirichlet(np.ones(6), 2)
    measurement = random.dirichlet(np.ones(6), 3)
    grid, conflict = combine_grid(table, history, measurement)
    for i, j in ((0, 2), (1, 1)):
        sources = [
            dict(zip(full[few].tolist(), history[i, few].tolist(), strict=True)),
            dict(zip(measured(5).tolist(), measurement[j].tolist(), strict=True)),
        ]
        assert_row(table, grid[i, j], conflict[i, j], "dsmc", free_model(names), sources)
    with pytest.raises(ValueError, match=r"7579 x 7579 focal elements: allowed are up to 8388608"):
        destinations("dsmc", free_model(names), [full, full])


@settings(deadline=None, max_examples=30)
@given(seeds, st.integers(2, 4), st.floats(0, 1))
def test_discounting_as_the_calculator(seed, size, reliability):
    model, (source,) = problem(seed, size, sources=1, alive=True)
    focal = np.array(list(source), dtype=np.uint32)
    table, embedding = history_table("yager", model, focal, measured(size))
    masses = np.array([list(source.values())])
    masses = masses if embedding is None else masses @ embedding
    before = masses.copy()
    found = discount_columns(table, masses, reliability)
    np.testing.assert_array_equal(masses, before)
    expected = reduce_source(model, discount(source, reliability, model))
    for mask, mass in zip(table.focal.tolist(), found[0].tolist(), strict=True):
        assert mass == pytest.approx(expected.get(mask & model.alive, 0.0), abs=1e-15)


def test_discounting_refuses():
    model = shafer_model(("A", "B"))
    table = rule_table("dsmc", model, [masks_of("A"), masks_of("B")])
    with pytest.raises(ValueError, match="without a column of total ignorance"):
        discount_columns(table, np.ones((1, 1)), 0.5)
    table, _ = history_table("dsmc", model, masks_of("A"), masks_of("B"))
    with pytest.raises(ValueError, match="reliability = 1.5: allowed is 0 to 1"):
        discount_columns(table, np.ones((1, 3)), 1.5)


def masks_of(text):
    return np.array(list(masks(("A", "B"), {text: 1.0})), dtype=np.uint32)
