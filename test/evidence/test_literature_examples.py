"""Worked examples of the literature, through the calculator, and again through ``evidencelib``.

The problems are those of the sources; what is not plain in a result is worked by hand in the
comment above it. Results are exact fractions, and the calculator must be right to 1e-15.

Sources
-------
Vol. 1, Vol. 2
    Smarandache and Dezert (editors): Advances and Applications of DSmT for Information Fusion,
    volumes 1 (2004) and 2 (2006).
Introduction
    Dezert and Smarandache: An Introduction to DSmT, arXiv:0903.0279, 2009.
Zadeh 1979
    On the validity of Dempster's rule of combination; the two doctors as in Vol. 1, chapter 5.
Tchamova et al. 2004
    Vol. 1, chapter 14.
"""

import json
import math
from fractions import Fraction

import evidencelib
import pytest

from gda_tracker.evidence.calculator import solve
from gda_tracker.evidence.frames import (
    element_name,
    hyper_power_set,
    parse_element,
    shafer_model,
)
from gda_tracker.evidence.problem import read_problem
from gda_tracker.evidence.rules import TotalConflictError

AB, ABC = ("A", "B"), ("A", "B", "C")
FREE = []
EXCLUSIVE_2 = ["A&B"]
EXCLUSIVE_3 = ["A&B", "A&C", "B&C"]


def fuse(rule, frame, empty, *sources, **more):
    model = {"empty": empty}
    sources = [{element: float(mass) for element, mass in source.items()} for source in sources]
    problem = {"frame": frame, "model": model, "sources": sources, "rule": rule, **more}
    (solution,) = solve(read_problem(json.dumps(problem)))
    return solution


def by_evidencelib(rule, frame, empty, *sources):
    free, model = evidencelib.Frame.dsmt(frame), evidencelib.Frame.hybrid(frame, empty=empty)
    own = free if rule in ("dsmc", "dsmh") else model
    bodies = [own.mass({x: float(mass) for x, mass in source.items()}) for source in sources]
    fused = getattr(bodies[0], rule)(*bodies[1:], **({"model": model} if rule == "dsmh" else {}))
    return {str(element): mass for element, mass in fused.items()}


def assert_masses(found, expected, tolerance=1e-15):
    assert set(found) == set(expected)
    for element, mass in expected.items():
        assert found[element] == pytest.approx(float(mass), abs=tolerance), element


def canonical(frame, empty, masses):
    """Masses by the element's set of Venn parts that the model leaves, whatever its name."""
    gone = 0
    for element in empty:
        gone |= parse_element(frame, element)
    return {parse_element(frame, element) & ~gone: mass for element, mass in masses.items()}


def masses(text):
    """Read ``element mass, element mass`` into exact fractions."""
    return {element: Fraction(mass) for element, mass in map(str.split, text.split(","))}


# Zadeh 1979. K = 1 - .1 * .1 = .99, of it A with B .9 * .9 = .81, A with C and B with C .09 each.
ZADEH = (masses("A .9, C .1"), masses("B .9, C .1"))
ZADEH_UNIONS = "A|B .81, A|C .09, B|C .09, C .01"

# Vol. 1, chapter 4: the two sources of the examples of hybrid models.
HYBRID = (
    masses("A&C .1, C .3, A&B .1, B .2, A .1, A|C .1, A|B .1"),
    masses("B&C .2, C .1, A&B .2, B .1, A .2, A|C .2"),
)

# Introduction, 2.6: one pair of sources under several rules.
COMPARED = (masses("A .1, B .4, C .2, A|B .3"), masses("A .5, B .1, C .3, A|B .1"))
COMPARED_UNIONS = "A .21, B .11, C .06, A|B .24, A|C .13, B|C .14, A|B|C .11"

# Vol. 2, chapter 1: two sources, the second column by column fuller.
COLUMNS_2 = (masses("A .6, A|B .4"), masses("B .3, A|B .7"))
COLUMNS_3 = (masses("A .6, A|B .4"), masses("A .2, B .3, A|B .5"))
COLUMNS_4 = (masses("A .6, B .3, A|B .1"), masses("A .2, B .3, A|B .5"))

# Introduction, 3.2: three sources for which PCR5 and PCR6 differ.
THREE = (
    masses("A .6, B .1, A|B .3"),
    masses("A .5, B .3, A|B .2"),
    masses("A .4, B .1, A|B .5"),
)

# Rule, frame, elements that are empty, sources, result, K.
EXAMPLES = [
    # Dempster: certain of the illness that both doctors think least likely.
    ("dempster", ABC, EXCLUSIVE_3, ZADEH, "C 1", 0.99),
    ("dsmc", ABC, FREE, ZADEH, "A&B .81, A&C .09, B&C .09, C .01", 0),
    # Each conflict to the union of the two that are in it; disjunctive: everything.
    ("dsmh", ABC, EXCLUSIVE_3, ZADEH, ZADEH_UNIONS, 0.99),
    ("dubois_prade", ABC, EXCLUSIVE_3, ZADEH, ZADEH_UNIONS, 0.99),
    ("disjunctive", ABC, EXCLUSIVE_3, ZADEH, ZADEH_UNIONS, 0.99),
    ("yager", ABC, EXCLUSIVE_3, ZADEH, "C .01, A|B|C .99", 0.99),
    # A with B, .81: halves. A with C, .09: A .09 * .9 / 1, C .09 * .1 / 1.
    # A = .405 + .081, C = .01 + 2 * .009.
    ("pcr5", ABC, EXCLUSIVE_3, ZADEH, "A .486, B .486, C .028", 0.99),
    ("pcr6", ABC, EXCLUSIVE_3, ZADEH, "A .486, B .486, C .028", 0.99),
    # Products, first source times second: A&B&C = A&C*B&C .02 + A&C*A&B .02 + A&C*B .01 + C*A&B .06
    # + A&B*B&C .02 + A&B*C .01 + A*B&C .02 = .16.
    (
        *("dsmc", ABC, FREE, HYBRID),
        "A&B&C .16, B&C .19, A&C .12, A&C|B&C .01, C .10, A&B .22, A&B|B&C .05, B .03, A .08, "
        "A|B&C .02, A|C .02",
        0,
    ),
    # These .16 go to the unions:
    # A&C*B&C .02 -> A&C|B&C    A&C*A&B .02 -> A&B|A&C    A&C*B .01 -> B|A&C
    # C*A&B .06 and A&B*C .01 -> C|A&B    A&B*B&C .02 -> A&B|B&C    A*B&C .02 -> A|B&C
    (
        *("dsmh", ABC, ["A&B&C"], HYBRID),
        "B&C .19, A&C .12, A&C|B&C .03, C .10, A&B .22, A&B|B&C .07, A&B|A&C .02, C|A&B .07, "
        "B .03, B|A&C .01, A .08, A|B&C .04, A|C .02",
        0.16,
    ),
    # A&B is dead itself. On top of what lives: A&B*A&B .02 -> u(A&B) = A|B; B*A .04, A*B .01,
    # A|B*A&B .02 -> A|B; beside A&B the other one is left: A .02 + .02, B .01 + .04, C .06 + .01,
    # A|C .02 + .02, A&C .02, B&C .02; A&C*B&C, A&C*B, A*B&C as above.
    (
        *("dsmh", ABC, ["A&B"], HYBRID),
        "B&C .26, A&C .14, A&C|B&C .03, C .17, B .08, B|A&C .01, A .12, A|B&C .04, A|C .06, "
        "A|B .09",
        0.38,
    ),
    # A: alive A*A .02, A*A|C .02, A|C*A .02, A|B*A .02, A|B*A|C .02, and beside a dead one
    #    A&C*A .02, A&B*A .02, A*B&C .02, A*A&B .02: .18.
    # B: B*B .02, A|B*B .01, A&C*B .01, A&B*B .01, B*B&C .04, B*A&B .04: .13.
    # C: C*C .03, C*A|C .06, A|C*C .01, A&C*C .01, C*B&C .06, C*A&B .06, A&B*C .01: .24.
    # A|C: A|C*A|C .02, C*A .06, A*C .01, beside a dead one .02 * 4: .17. B|C: C*B .03, B*C .02.
    # A|B: B*A .04, A*B .01, A|B*B&C .02, A|B*A&B .02, u: A&B*A&B .02: .11.
    # A|B|C: B*A|C .04, A|C*B .01, A|B*C .01, u: A&C*B&C, A&C*A&B, A&B*B&C .02 each: .12.
    (
        *("dsmh", ABC, EXCLUSIVE_3, HYBRID),
        "A .18, B .13, C .24, A|B .11, A|C .17, B|C .05, A|B|C .12",
        0.75,
    ),
    # B and C are left, with B&C. Of two dead ones the union of u: A&C*A&B .02 -> B|C, A*A .02 too,
    # as ignorance, for u(A) is dead; A&C*A .02 -> C; A&B*A&B, A&B*A, A*A&B .02 each -> B.
    # B&C: all that meets in it, .06 + .03 + .04 + .02 + .04 + .02 + .01 + .02 + .01 + .02 = .27,
    # and A&C, A&B, A beside B&C .02 each: .33. B: B*B .02, A|B*B .01, .06 of u, and what stands
    # beside a dead one, .01 + .01 + .04 + .04 + .01 + .02 + .02 = .15: .24.
    ("dsmh", ABC, ["A"], HYBRID, "B&C .33, B .24, C .39, B|C .04", 0.58),
    # C alone is left; .12 meet there: C*C .03, C*A|C .06, A|C*C .01, A|C*A|C .02.
    ("dsmh", ABC, ["A", "B"], HYBRID, "C 1", 0.88),
    # A = .1 * .5 + .1 * .1 + .3 * .5, A&B = .1 * .1 + .4 * .5, (A|B)&C = .2 * .1 + .3 * .3.
    (
        *("dsmc", ABC, FREE, COMPARED),
        "A .21, B .11, C .06, A|B .03, A&B .21, A&C .13, B&C .14, A&C|B&C .11",
        0,
    ),
    ("dsmh", ABC, EXCLUSIVE_3, COMPARED, COMPARED_UNIONS, 0.59),
    ("dubois_prade", ABC, EXCLUSIVE_3, COMPARED, COMPARED_UNIONS, 0.59),
    ("yager", ABC, EXCLUSIVE_3, COMPARED, "A .21, B .11, C .06, A|B .03, A|B|C .59", 0.59),
    # Divided by 1 - .59: .512, .268, .146, .073.
    ("dempster", ABC, EXCLUSIVE_3, COMPARED, "A 21/41, B 11/41, C 6/41, A|B 3/41", 0.59),
    # K = .6 * .3 = .18, in the ratio 2 to 1: A .42 + .12, B .12 + .06; A .50 + .12, B .12 + .06.
    ("pcr5", AB, EXCLUSIVE_2, COLUMNS_2, "A .54, B .18, A|B .28", 0.18),
    ("pcr5", AB, EXCLUSIVE_2, COLUMNS_3, "A .62, B .18, A|B .20", 0.18),
    # A .44, B .27 meet; .6 * .3 gives A .12, B .06; .3 * .2 gives A .024, B .036.
    ("pcr5", AB, EXCLUSIVE_2, COLUMNS_4, "A .584, B .366, A|B .05", 0.24),
    ("pcr6", AB, EXCLUSIVE_2, COLUMNS_4, "A .584, B .366, A|B .05", 0.24),
]


@pytest.mark.parametrize(("rule", "frame", "empty", "sources", "result", "conflict"), EXAMPLES)
def test_example(rule, frame, empty, sources, result, conflict):
    expected = masses(result)
    assert sum(expected.values()) == 1
    solution = fuse(rule, frame, empty, *sources)
    assert_masses(solution.result, expected)
    assert solution.conflict == pytest.approx(conflict, abs=1e-15)
    theirs = by_evidencelib(rule, frame, empty, *sources)
    assert_masses(canonical(frame, empty, theirs), canonical(frame, empty, expected), 1e-12)


def test_pcr5_and_pcr6_of_three_sources():
    """Introduction, 3.2: the dead triples worked in fractions.

    A and B in one triple are dead. PCR5 weighs A and B by the product of the masses on them, PCR6
    by the sum; A|B beside the two takes its share as well.
    """
    (a1, b1, i1), (a2, b2, i2), (a3, b3, i3) = (tuple(source.values()) for source in THREE)
    # What lives: A from triples of A and A|B but not A|B alone, B likewise.
    ignorance = i1 * i2 * i3
    lives = {
        "A": (a1 + i1) * (a2 + i2) * (a3 + i3) - ignorance,
        "B": (b1 + i1) * (b2 + i2) * (b3 + i3) - ignorance,
        "A|B": ignorance,
    }
    # The twelve dead triples by hand: (masses on A, masses on B, masses on A|B).
    dead = [
        *(([a1, a2], [b3], []), ([a1, a3], [b2], []), ([a2, a3], [b1], [])),
        *(([a1], [b2, b3], []), ([a2], [b1, b3], []), ([a3], [b1, b2], [])),
        *(([a1], [b2], [i3]), ([a1], [b3], [i2]), ([a2], [b1], [i3])),
        *(([a2], [b3], [i1]), ([a3], [b1], [i2]), ([a3], [b2], [i1])),
    ]
    rounded = {
        "pcr5": masses("A .723281, B .182460, A|B .094259"),
        "pcr6": masses("A .743496, B .162245, A|B .094259"),
    }
    for rule, weigh in (("pcr5", math.prod), ("pcr6", sum)):
        worked = dict(lives)
        for triple in dead:
            amount = math.prod(math.prod(group) for group in triple)
            weights = [weigh(group) if group else 0 for group in triple]
            for element, weight in zip(worked, weights, strict=True):
                worked[element] += amount * weight / sum(weights)
        assert sum(worked.values()) == 1
        solution = fuse(rule, AB, EXCLUSIVE_2, *THREE)
        assert_masses(solution.result, worked)
        assert_masses(solution.result, rounded[rule], 5e-7)
        assert solution.conflict == pytest.approx(0.343, abs=1e-15)
        assert_masses(by_evidencelib(rule, AB, EXCLUSIVE_2, *THREE), worked, 1e-12)


def test_total_conflict():
    """Vol. 1, chapter 5: sources with no element in common; Dempster divides 0 by 0, DSmC not."""
    frame = ("A", "B", "C", "D")
    sources = masses("A .99, C .01"), masses("B .98, D .02")
    exclusive = ["A&B", "A&C", "A&D", "B&C", "B&D", "C&D"]
    with pytest.raises(TotalConflictError):
        fuse("dempster", frame, exclusive, *sources)
    classic = fuse("dsmc", frame, FREE, *sources)
    assert_masses(classic.result, masses("A&B .9702, A&D .0198, B&C .0098, C&D .0002"))


def test_pignistic_probabilities_of_two_elements():
    """Dezert, Smarandache and Daniel 2004: P(A) on the free and on Shafer's model."""
    a, b, meet, join = 0.4, 0.3, 0.1, 0.2
    source = {"A": a, "B": b, "A&B": meet, "A|B": join}
    free = fuse("pignistic", AB, FREE, source)
    # Two of the three parts of A|B are in A, one of the two of B.
    expected = {"A": a + b / 2 + meet + 2 / 3 * join, "B": b + a / 2 + meet + 2 / 3 * join}
    assert_masses(free.result, expected, 1e-14)
    assert free.pignistic == free.result
    only = {"A": a, "B": b, "A|B": meet + join}
    shafer = fuse("pignistic", AB, EXCLUSIVE_2, only)
    assert_masses(shafer.result, {"A": a + 0.15, "B": b + 0.15}, 1e-14)
    assert shafer.entropy_nats == pytest.approx(-0.55 * math.log(0.55) - 0.45 * math.log(0.45))
    # Parts A alone, B alone, A&B: half of A, half of B, both halves and A&B; a third of A|B each.
    parts = [a / 2 + join / 3, b / 2 + join / 3, (a + b) / 2 + meet + join / 3]
    assert free.entropy_nats == pytest.approx(-sum(p * math.log(p) for p in parts))


def test_discounting():
    """Shafer 1976: m(A) alpha, and 1 - alpha to ignorance."""
    found = fuse(
        "discount", ABC, EXCLUSIVE_3, {"A": 0.5, "B|C": 0.3, "A|B|C": 0.2}, reliability=0.8
    )
    assert_masses(found.result, {"A": 0.4, "B|C": 0.24, "A|B|C": 0.36})
    assert found.conflict == 0.0


# Tchamova et al. 2004, 14.3.2.1: the hyper-power set of the first frame, without the empty set.
HYPER_POWER_SET = """
    VS  S  B  VS&S&B  VS&S  VS&B  S&B  (VS|S)&B  (VS|B)&S  (S|B)&VS  (VS&S)|(VS&B)|(S&B)
    (VS&S)|B  (VS&B)|S  (S&B)|VS  VS|S  VS|B  S|B  VS|S|B
"""

# 14.3.2.2: what the constraints of M1 imply in the second frame.
IMPLIED = {
    **dict.fromkeys(["(FA|F)&C", "(FA|C)&F", "(F|C)&FA", "(FA&F)|(FA&C)|(F&C)"]),
    "(FA&F)|C": "C",
    "(FA&C)|F": "F",
    "(F&C)|FA": "FA",
}
CONSTRAINTS = ["FA&F", "FA&C", "F&C", "FA&F&C"]


def test_hyper_power_set_of_the_chapter():
    masks = {parse_element(("VS", "S", "B"), text) for text in HYPER_POWER_SET.split()}
    assert masks == set(hyper_power_set(3).tolist())


def test_model_of_the_chapter():
    frame = ("FA", "F", "C")
    problem = {"frame": frame, "model": {"empty": CONSTRAINTS}, "rule": "pignistic"}
    model = read_problem(json.dumps({**problem, "sources": [{"FA": 1}]})).model
    assert model == shafer_model(frame)
    for text, reduced in IMPLIED.items():
        mask = parse_element(frame, text)
        if reduced is None:
            assert mask & model.alive == 0
        else:
            assert element_name(frame, mask, model) == reduced


def test_entries_of_the_chapter_on_both_frames():
    """14.3.2: memberships .2, .5, .3 become masses; fused with a history, seen in both frames.

    m_upd(S) = .6 * .5, m_upd(VS&S) = .1 * .5 + .6 * .2 and so on; in the second frame the mass of
    an intersection goes to the union of its two.
    """
    grades = {"VS": 0.4, "S": 1.0, "B": 0.6}
    measured = {label: grade / sum(grades.values()) for label, grade in grades.items()}
    history = {"VS": 0.1, "S": 0.6, "B": 0.3}
    first = fuse("dsmc", ("VS", "S", "B"), FREE, history, measured)
    meet = {"VS&S": 0.17, "VS&B": 0.09, "S&B": 0.33}
    assert_masses(first.result, {"VS": 0.02, "S": 0.30, "B": 0.09, **meet})
    assert first.conflict == 0.0
    second = fuse(
        *("dsmh", ("FA", "F", "C"), CONSTRAINTS),
        *({"FA": s["VS"], "F": s["S"], "C": s["B"]} for s in (history, measured)),
    )
    join = {"FA|F": 0.17, "FA|C": 0.09, "F|C": 0.33}
    assert_masses(second.result, {"FA": 0.02, "F": 0.30, "C": 0.09, **join})
    assert second.conflict == pytest.approx(0.59, abs=1e-15)
    # F .30 + half of .17 and .33, and the entropy of the three.
    probability = {"FA": 0.02 + 0.085 + 0.045, "F": 0.30 + 0.085 + 0.165, "C": 0.09 + 0.045 + 0.165}
    assert_masses(second.pignistic, probability, 1e-14)
    entropy = -sum(p * math.log(p) for p in probability.values())
    assert second.entropy_nats == pytest.approx(entropy, abs=1e-14)


def test_a_certain_history_is_deaf_under_dempster():
    """14.7: once unity stands on one hypothesis Dempster's rule learns no more."""
    frame, certain = ("FA", "F", "C"), {"F": 1.0}
    against = {"FA": 0.05, "F": 0.05, "C": 0.9}
    assert fuse("dempster", frame, CONSTRAINTS, certain, against).result == {"F": 1.0}
    with pytest.raises(TotalConflictError):
        fuse("dempster", frame, CONSTRAINTS, certain, {"C": 1.0})
    heard = fuse("pcr5", frame, CONSTRAINTS, certain, against)
    # F .05, and of F with C F .9 / 1.9, C .81 / 1.9; of F with FA F .05 / 1.05, FA .0025 / 1.05.
    expected = {"FA": 0.0025 / 1.05, "F": 0.05 + 0.9 / 1.9 + 0.05 / 1.05, "C": 0.81 / 1.9}
    assert_masses(heard.result, expected)
