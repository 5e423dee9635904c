"""diagnosis.json and the page of a trace: what is promised of them, from an answer whose content is known."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer

from estimator import diagnosis as traced
from estimator.record import Record
from estimator.scaling import Array
from estimator.settings import Device, ObserverSettings
from hil.cli.show_diagnosis import finish, print_diagnosis
from hil.errors import InputError
from hil.records.atomic import sealed
from hil.records.diagnosis import Diagnosis, Probabilities, load_diagnosis, save_diagnosis, to_model
from hil.records.result import Result, save_result
from hil.report.diagnosis import write_report
from hil.report.diagnosis.equations import plain, typeset
from hil.report.diagnosis.page import Pictures, headline, write_page
from hil.report.diagnosis.tables import coefficients, probable
from hil.tracing.addition import add_found, additions
from hil.verdict.next_step import after_trace

N, RATE, RESONANCE, NOISE = 16000, 4000.0, 200.0, 9e-5
DEVICE = Device(
    sample_rate=RATE,
    stiffness=((2 * math.pi * RESONANCE) ** 2,) * 2 + (0.0,),
    damping=(1.0, 1.0, 0.0),
    amplitude=1e-4,
    sense_gain=(-890.0, -890.0),
    noise=(NOISE, NOISE),
)
DESIGN_KEYS = {"verdict", "effects", "ambiguity_groups", "before", "after", "held_out", "rejected"}
FIT_KEYS = {
    "innovation_rms", "noise_floor", "ratio", "whiteness_p", "simulation_rmse", "angle_error_rms_rad",
    "rate_error_rms_rad_s",
}  # fmt: skip


def ride() -> Record:
    t = np.arange(N) / RATE
    swing = 0.089 * (1 + 0.3 * np.sin(6.0 * t)) * np.cos(2 * np.pi * RESONANCE * t)
    sense = swing[:, None] * np.stack([np.cos(3 * t), np.sin(3 * t)], axis=1)
    return Record(sense, np.zeros((N, 2, 1)), np.full(N, 1 / RATE))


def answer(*, found: bool = True, verdict: traced.Verdict = traced.Verdict.EXPLAINED) -> traced.Diagnosis:
    """An answer with one effect, or none; the residual before is three times the noise."""
    random = np.random.default_rng(1)

    def residual(size: float) -> Array:
        return size * NOISE * random.standard_normal((N, 2))

    def fit(size: float) -> traced.Fit:
        return traced.Fit((size * NOISE, size * NOISE), (NOISE, NOISE), size, 0.0 if size > 1 else 0.4, math.nan, 0.3)

    effect = traced.Found(
        "cubic_stiffness",
        "Cubic stiffness of each axis",
        ("ẍ = … -k3x*x**3", "ÿ = … -k3y*y**3"),
        {
            "k3x": traced.Interval(1e13, 0.99e13, 1.01e13, "1/(m²·s²)"),
            "k3y": traced.Interval(2e12, 1e12, math.inf, "1"),
        },
        1.6e5,
        "the control law subtracts its force",
    )
    after = 1.0 if found else 3.0
    return traced.Diagnosis(
        verdict,
        (effect,) if found else (),
        (
            traced.Separation(
                "cubic_stiffness", "sense_cubic", 0.9995, "step the amplitude", 0.6, experiment="amplitude"
            ),
        )
        if found
        else (),
        (
            traced.Rejected("sense_gain", "explains <nothing>", {"gy": traced.Interval(0.0, -1e-3, 2e-3, "1")}, 3.0),
            traced.Rejected("dry_friction", "predicts worse"),
        ),
        (traced.Finding("line", "around 3 × the resonance", 4e-5, 37.0),),
        fit(3.0),
        fit(after),
        fit(3.0),
        fit(after),
        residual(3.0),
        residual(after),
        9600,
        ("the residual is 3 × the noise floor",),
    )


def written(folder: Path, found: traced.Diagnosis) -> str:
    diagnosis = to_model(found, record="ride <1>", bench="S-test")
    (folder / "bench.toml").write_text("[device]\n", encoding="utf-8")
    return write_report(folder, found, diagnosis, ride(), DEVICE, ObserverSettings()).read_text(encoding="utf-8")


def test_the_page_names_the_file_that_was_traced(tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text("[device]\n", encoding="utf-8")
    diagnosis, capture = to_model(answer(), record="ride", bench="S-test"), Path("elsewhere") / "ride.arrow"
    diagnosis = diagnosis.model_copy(update={"verdict": "unexplained"})
    path = write_report(tmp_path, answer(), diagnosis, ride(), DEVICE, ObserverSettings(), capture=capture)
    assert "hil trace elsewhere/ride.arrow --bench" in path.read_text(encoding="utf-8")


def test_the_file_has_what_was_promised(tmp_path: Path) -> None:
    save_diagnosis(tmp_path / "diagnosis.json", to_model(answer(), record="ride", bench="S-test"))
    said = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
    assert said.keys() >= DESIGN_KEYS
    assert said["held_out"].keys() == {"before", "after"}
    for fit in (said["before"], said["after"], *said["held_out"].values()):
        assert fit.keys() >= FIT_KEYS
    assert said["verdict"] == "explained"
    assert said["effects"][0]["coefficients"]["k3x"] == {
        "value": 1e13, "ci95": [0.99e13, 1.01e13], "unit": "1/(m²·s²)",
    }  # fmt: skip
    assert said["separations"][0].items() >= {
        ("effect", "cubic_stiffness"), ("with", "sense_cubic"), ("separate_by", "step the amplitude"),
    }  # fmt: skip
    assert said["rejected"][0].items() >= {("name", "sense_gain"), ("reason", "explains <nothing>")}
    assert said["before"]["innovation_rms"] == pytest.approx(3 * NOISE)
    assert said["equations"] == ["ẍ = … -k3x*x**3", "ÿ = … -k3y*y**3"]


def test_groups_of_the_version_before_are_read(tmp_path: Path) -> None:
    """`confusable` had pairs, and among them those that the record told apart once both were fitted (`behind`)."""
    said = to_model(answer(), record="ride", bench="S-test").model_dump(mode="json", by_alias=True)
    (pair,) = said.pop("separations")
    del said["ambiguity_groups"], said["unconfirmed"]
    old = said | {"confusable": [pair | {"behind": None}, pair | {"with": "sense_gain", "behind": 42.0}]}
    read = Diagnosis.model_validate(old)
    assert read.ambiguity_groups == (("cubic_stiffness", "sense_cubic"),)
    assert [one.with_ for one in read.separations] == ["sense_cubic"]
    assert "confusable" not in read.model_dump()


def test_the_best_candidate_that_a_check_rejects_is_told_as_not_confirmed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In file, terminal and page: coefficients, the check that failed, what it leaves; and no effect is named."""
    with_it, without = answer(), answer(found=False, verdict=traced.Verdict.UNEXPLAINED)
    best = traced.Unconfirmed(with_it.effects, ("on the part held out it gains −3",), with_it.held_out_after)
    found = replace(without, unconfirmed=best)
    model = to_model(found, record="ride", bench="S-test")
    assert model.effects == ()
    assert model.unconfirmed is not None
    assert model.unconfirmed.held_out.ratio == 1.0
    print_diagnosis(model)
    told, page = " ".join(capsys.readouterr().out.split()), written(tmp_path, found)
    assert "not confirmed: cubic_stiffness" in told
    for text in (told, " ".join(page.split())):
        assert "on the part held out it gains −3" in text
        assert "k3x" in text
        assert re.search(r"with it the residual held out is 1[.0]* × the noise floor", text)


def test_what_is_no_number_is_null_and_the_file_reads_back(tmp_path: Path) -> None:
    model = to_model(answer(), record="ride", bench="S-test")
    assert model.before.simulation_rmse is None
    assert model.effects[0].coefficients["k3y"].ci95 == (1e12, None)
    save_diagnosis(tmp_path / "d.json", model)
    assert load_diagnosis(tmp_path / "d.json") == model


def test_a_file_that_is_none_is_refused_by_its_key(tmp_path: Path) -> None:
    save_diagnosis(tmp_path / "d.json", to_model(answer(), record="ride", bench="S-test"))
    text = (tmp_path / "d.json").read_text(encoding="utf-8").replace('"explained"', '"certain"')
    (tmp_path / "d.json").write_text(sealed(text), encoding="utf-8")
    with pytest.raises(InputError, match=r"d\.json: verdict: .*trace the record anew"):
        load_diagnosis(tmp_path / "d.json")
    with pytest.raises(InputError, match="cannot be read"):
        load_diagnosis(tmp_path / "absent.json")


@pytest.mark.moderate
def test_only_what_explains_is_added() -> None:
    (addition,) = additions(to_model(answer(), record="ride", bench="S-test"))
    assert addition.name == "cubic_stiffness"
    assert addition.coefficients["k3x"][0] == 1e13
    assert addition.coefficients["k3x"][1] == "95 %: ± 1e+11 1/(m²·s²)"
    assert addition.coefficients["k3y"][1] == "95 %: 1e+12 to unbounded 1"
    for verdict in (traced.Verdict.UNEXPLAINED, traced.Verdict.ADEQUATE, traced.Verdict.PARTLY):
        assert additions(to_model(answer(verdict=verdict), record="ride", bench="S-test")) == []


def test_a_fault_is_told_first_and_not_declared(tmp_path: Path) -> None:
    found = replace(answer(), reasons=("x and y are exchanged", "b"))
    diagnosis = to_model(found, record="ride", bench="S-test", fault=True)
    assert additions(diagnosis) == []
    added = add_found(diagnosis, tmp_path / "a.toml", tmp_path / "b.toml")
    assert added == ([], f"{tmp_path / 'b.toml'}: not written; x and y are exchanged")
    assert headline(diagnosis) == "X and y are exchanged"
    (tmp_path / "bench.toml").write_text("[device]\n", encoding="utf-8")
    assert "--add" not in str(after_trace(tmp_path, diagnosis))


def test_a_residual_that_falls_by_no_digit_shown_leaves_the_evidence_to_tell(tmp_path: Path) -> None:
    same = replace(answer(), held_out_before=replace(answer().held_out_after, ratio=1.0004))
    diagnosis = to_model(same, record="ride", bench="S-test")
    assert headline(diagnosis).startswith("The model lacks: cubic stiffness of each axis; it raises 2 ln L by 160")
    (tmp_path / "bench.toml").write_text("[device]\n", encoding="utf-8")
    page = write_page(tmp_path, diagnosis, Pictures(), ("Record", "1 s", "9 rows"), "1 s").read_text(encoding="utf-8")
    assert "Residual before" not in page
    assert "2 ln L, on the fitted part" in page


def test_a_coefficient_of_which_the_record_says_nothing_is_0_within_its_interval() -> None:
    (effect,) = answer().effects
    unbounded = traced.Interval(2.0, -math.inf, math.inf, "1")
    nothing = replace(effect, coefficients={"olx": traced.Interval(4.8e-90, -1.96e-4, 1.96e-4, "1"), "a": unbounded})
    (said,) = to_model(replace(answer(), effects=(nothing,)), record="ride", bench="S-test").effects
    assert said.coefficients["olx"].value == 0.0
    assert said.coefficients["olx"].ci95 == (-1.96e-4, 1.96e-4)
    assert said.coefficients["a"].value == 2.0


@pytest.mark.slow
def test_the_page_is_one_file_and_says_it_all(tmp_path: Path) -> None:
    page = written(tmp_path, answer())
    assert not re.search(r'(?:src|href)="(?!#)', page)
    assert "<script" not in page
    for words in (
        "Explained.", "the residual falls from 3.00 to 1.00 × the noise floor",
        "cannot be distinguished from sense cubic",
        "<i>k</i><sub>3x</sub>", "held out, before", "step the amplitude", "|gy| &lt; 0.0020",
        "explains &lt;nothing&gt;",
        "ride &lt;1&gt;", "Residual over time", "Spectrum of the residual",
        "Evidence for the candidates", "Coefficients", "the control law subtracts its force",
    ):  # fmt: skip
        assert words in page, words
    assert page.count("<figure") == 4  # an interval of ± 1 % would be a dot on a drawing of coefficients


@pytest.mark.long
def test_intervals_that_can_be_seen_are_drawn(tmp_path: Path) -> None:
    (effect,) = answer().effects
    wide = {"k3x": traced.Interval(1e13, 0.7e13, 1.3e13, "1/(m²·s²)")}
    page = written(tmp_path, replace(answer(), effects=(replace(effect, coefficients=wide),)))
    assert page.count("<figure") == 5
    assert "Each coefficient over its own estimate" in page


@pytest.mark.slow
@pytest.mark.parametrize(
    ("verdict", "tone", "word"),
    [(traced.Verdict.ADEQUATE, "good", "Adequate"), (traced.Verdict.UNEXPLAINED, "bad", "Unexplained")],
)
def test_a_page_without_an_effect_has_no_after(tmp_path: Path, verdict: traced.Verdict, tone: str, word: str) -> None:
    page = written(tmp_path, answer(found=False, verdict=verdict))
    assert f'class="verdict {tone}"><strong>{word}.' in page
    assert "What the model lacks" not in page
    assert "held out, before" not in page
    assert '<h2 id="error">Error</h2>' in page


def partly() -> traced.Diagnosis:
    """The effect accounts for most; a line is left."""
    line = traced.Finding("line", "a line at 311 Hz", 2e-5, 21.0)
    return replace(answer(verdict=traced.Verdict.PARTLY), share=0.936, left=(line,))


def test_a_part_has_its_share_and_what_is_left(tmp_path: Path) -> None:
    model = to_model(partly(), record="ride", bench="S-test")
    save_diagnosis(tmp_path / "d.json", model)
    said = json.loads((tmp_path / "d.json").read_text(encoding="utf-8"))
    assert (said["verdict"], said["share"]) == ("partly explained", 0.936)
    assert [one["text"] for one in said["left"]] == ["a line at 311 Hz"]
    assert load_diagnosis(tmp_path / "d.json") == model


def test_a_headline_says_what_is_wrong_with_a_constant() -> None:
    in_conflict = replace(partly(), share=None, left=(), separations=())
    said = headline(to_model(in_conflict, record="ride", bench="S-test"))
    assert "without it a constant of the model is one that the device cannot have" in said
    assert "falls" not in said
    nothing = replace(answer(found=False, verdict=traced.Verdict.UNEXPLAINED), reasons=("dyy comes out negative", "b"))
    said = headline(to_model(nothing, record="ride", bench="S-test"))
    assert said == "No effect of the catalogue explains the residual: dyy comes out negative"


@pytest.mark.parametrize(
    ("verdict", "code"),
    [
        (traced.Verdict.ADEQUATE, 0),
        (traced.Verdict.EXPLAINED, 0),
        (traced.Verdict.PARTLY, 1),
        (traced.Verdict.UNEXPLAINED, 1),
    ],
)
def test_the_exit_code_says_whether_something_is_left(tmp_path: Path, verdict: traced.Verdict, code: int) -> None:
    with pytest.raises(typer.Exit) as end:
        finish(tmp_path, to_model(answer(verdict=verdict), record="ride", bench="S-test"), as_json=False)
    assert end.value.exit_code == code


def test_a_trace_ends_with_the_command_that_comes_next(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(typer.Exit):
        finish(
            tmp_path, to_model(answer(), record="ride", bench="S-test"), as_json=False, added=Path("better.bench.toml")
        )
    assert capsys.readouterr().out.splitlines()[-1] == "next       hil run better.bench.toml"


def test_the_page_says_what_comes_next_above_everything_else(tmp_path: Path) -> None:
    folder, said = tmp_path / "trace", to_model(answer(), record="ride", bench="S-test")
    folder.mkdir()
    (tmp_path / "ride").mkdir()
    (folder / "bench.toml").write_text("[device]\n", encoding="utf-8")
    page = write_page(folder, said, Pictures(), ("Record", "4 s", ""), "4 s").read_text(encoding="utf-8")
    command = f"hil show {folder} --add better.bench.toml"
    assert page.index(f'<p class="next">Next: <code>{command}</code>') < page.index('<dl class="key">')
    (folder / "bench.toml").unlink()
    assert "Next:" not in write_page(folder, said, Pictures(), ("Record", "4 s", ""), "4 s").read_text(encoding="utf-8")


def test_the_truth_of_an_effect_stands_beside_what_was_found() -> None:
    said = to_model(answer(), record="ride", bench="S-test")
    table = coefficients(said, {"k3x": 1.0002e13, "kxx": None})
    heads = re.findall(r"<th scope=\"col\"[^>]*>([^<]*)", table)
    assert heads == ["coefficient", "estimate", "truth", "95 % interval", "unit"]
    (k3x,) = re.findall(r"k3x</th>(.*?)</tr>", table)
    assert re.findall(r">([^<]+)</td>", k3x)[:2] == ["(1.000 ± 0.010) × 10¹³", "1.000 × 10¹³"]
    assert "truth" not in coefficients(said, {"kxx": None})
    assert "truth" not in coefficients(said)


def test_a_probability_names_its_effect_only_where_another_is_meant() -> None:
    assert probable(Probabilities(effect="drag", classes={"drag": 0.9, "sense_gain": 0.1})) == (
        "probabilities for drag: drag 90\u00a0%, sense gain 10\u00a0%"
    )
    assert probable(Probabilities(effect="drag", classes={"sense_gain": 1.0})) == (
        "probabilities for drag: sense gain 100\u00a0%"
    )
    assert probable(Probabilities(effect=None, classes={"nothing": 1.0})) == "probabilities: nothing 100\u00a0%"


def test_a_terminal_says_what_a_part_acts_like_and_what_is_left(capsys: pytest.CaptureFixture[str]) -> None:
    print_diagnosis(to_model(partly(), record="ride", bench="S-test"))
    out = capsys.readouterr().out
    for words in (
        "partly explained", "acts like: Cubic stiffness of each axis", "accounts for 93.6% of the power",
        "the residual that is left\n", "a line at 311 Hz", "the residual without it\n",
    ):  # fmt: skip
        assert words in out, words
    print_diagnosis(to_model(answer(), record="ride", bench="S-test"))
    out = capsys.readouterr().out
    assert "acts like" not in out
    assert "accounts for" not in out
    assert "what is left" not in out


@pytest.mark.slow
def test_the_page_of_a_part_is_not_green(tmp_path: Path) -> None:
    page = written(tmp_path, partly())
    assert 'class="verdict open"><strong>Partly explained.' in page
    for words in ("Something acts like: cubic stiffness", "93.6 % of its power above the floor", "What is left"):
        assert words in page, words
    assert "a line at 311" in page.lower()
    assert "The model lacks" not in page


@pytest.mark.slow
def test_a_record_of_one_axis_and_few_cycles_has_a_page(tmp_path: Path) -> None:
    found, short = answer(), slice(0, 400)

    def one(fit: traced.Fit) -> traced.Fit:
        return replace(fit, innovation_rms=fit.innovation_rms[:1], noise_floor=fit.noise_floor[:1])

    found = replace(
        found, before=one(found.before), after=one(found.after), held_out_before=one(found.held_out_before),
        held_out_after=one(found.held_out_after), residual_before=found.residual_before[short, :1],
        residual_after=found.residual_after[short, :1], split=240,
    )  # fmt: skip
    record, single = ride().part(short), replace(DEVICE, stiffness=DEVICE.stiffness[:1], damping=(1.0,))
    single = replace(single, sense_gain=(-890.0,), noise=(NOISE,))
    record = Record(record.sense[:, :1], record.drive[:, :1], record.step)
    diagnosis = to_model(found, record="ride", bench="one")
    page = write_report(tmp_path, found, diagnosis, record, single, ObserverSettings()).read_text(encoding="utf-8")
    assert "Residual over time" in page


@pytest.mark.parametrize(
    ("plain", "set_"),
    [
        ("-k3x*x**3", "− <i>k</i><sub>3x</sub>\u202f<i>x</i><sup>3</sup>"),
        ("ẍ = -d3y*vy*y**2", "<i>ẍ</i> = − <i>d</i><sub>3y</sub>\u202f<i>ẏ</i>\u202f<i>y</i><sup>2</sup>"),
        ("fx*tanh(100.0*vx)", "<i>f</i><sub>x</sub>\u202ftanh(100\u202f<i>ẋ</i>)"),
        ("x\u0308 += -k3x*x**3", "<i>ẍ</i> = … − <i>k</i><sub>3x</sub>\u202f<i>x</i><sup>3</sup>"),
        ("sensed y += gy*y", "sensed <i>y</i> = … + <i>g</i><sub>y</sub>\u202f<i>y</i>"),
        ("Ω → Ω + c Ω³/R²", "<i>Ω</i> → <i>Ω</i> + <i>c</i> <i>Ω</i>³/<i>R</i>²"),
        ("V → hi above hi", "<i>V</i> → hi above hi"),
        ("a < b", "<i>a</i> &lt; <i>b</i>"),
    ],
)
def test_equations_are_set(plain: str, set_: str) -> None:
    assert typeset(plain) == set_


def test_equations_on_a_terminal() -> None:
    assert plain("x\u0308 += -k3x*x**3") == "ẍ = … − k3x x³"
    assert plain("sensed y += gy*y") == "sensed y = … + gy y"


@pytest.mark.slow
def test_how_probable_each_account_is_stands_in_the_file_and_on_the_page(tmp_path: Path) -> None:
    shares = {"cubic_stiffness": 0.9, "sense_cubic": 0.097, "drag": 0.003}
    sentence = "the record does not determine kxx and drive_gain_x"
    found = replace(
        answer(), probabilities=(traced.Classes("cubic_stiffness", shares),), undetermined=(sentence,)
    )  # fmt: skip
    said = to_model(found, record="ride", bench="S-test")
    save_diagnosis(tmp_path / "diagnosis.json", said)
    kept = json.loads((tmp_path / "diagnosis.json").read_text(encoding="utf-8"))
    assert kept["probabilities"] == [{"effect": "cubic_stiffness", "classes": shares}]
    assert kept["undetermined"] == [sentence]
    assert load_diagnosis(tmp_path / "diagnosis.json") == said
    page = written(tmp_path, found)
    assert "Probabilities for cubic stiffness: cubic stiffness 90\u00a0%, sense cubic 10\u00a0%" in page
    assert "drag 0%" not in page
    assert "oes not determine kxx and drive_gain_x" in page


@pytest.mark.long
def test_a_page_that_names_nothing_tells_of_nothing_found(tmp_path: Path) -> None:
    nothing = replace(answer(found=False, verdict=traced.Verdict.UNEXPLAINED), angle_moved=5.54)
    page = written(tmp_path, nothing)
    assert "by what was found" not in page
    assert "The angle moves by" in page
    assert "largest change, by the fitted candidate that is not named" in page
    spectrum = page[page.index("Spectrum of the residual") :].partition("</svg>")[0]
    assert "3.00 times the floor." in spectrum
    assert "before" not in spectrum
    named = written(tmp_path, replace(answer(), angle_moved=5.54))
    assert "largest change, by what was found" in named
    assert "3.00 times the floor before, 1.00 after." in named


def test_the_first_screen_says_of_what_record_a_trace_is(tmp_path: Path) -> None:
    folder, said = tmp_path / "20250314-101500-trace", to_model(answer(), record="ride", bench="S-test")
    folder.mkdir()

    def top() -> str:
        page = write_page(folder, said, Pictures(), ("Record", "4.00 s", "16 000 samples"), "4.00 s").read_text(
            encoding="utf-8"
        )
        (line,) = re.findall(r'<p class="facts">(.*?)</p>', page)
        return re.sub(r"<[^>]+>", "", line)

    assert top().startswith("14 March 2025, 10:15 bench S-test 4.00 s gyrohil ")  # an imported record has no link
    (tmp_path / "ride").mkdir()
    run = Result(run="ride", seconds=4.0, samples=N, complete=True, link="pty:/somewhere/s-slow.scenario.toml")
    save_result(tmp_path / "ride" / "result.json", run)
    assert " pty:s-slow.scenario.toml 4.00 s " in top()
    (tmp_path / "ride" / "result.json").write_text("{")
    assert "pty:" not in top()
    pool = write_page(folder, said, Pictures(), ("Records", "16 000", "samples, 9600 fitted"), "16 000 samples")
    assert "<span>16 000 samples</span>" in pool.read_text(encoding="utf-8")
