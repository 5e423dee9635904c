"""Which tests belong to which module: those that say what it promises, and take seconds."""

_STOPS = ["tests/loop/test_armed.py", "tests/verdict/test_safety.py"]
_KEYED = ["tests/wire/test_sessions.py", "tests/wire/test_keyed.py::test_the_counter_ends_and_does_not_wrap"]
_KEY_FILE = [
    f"tests/wire/test_keyed.py::{name}"
    for name in (
        "test_a_key_file_is_its_owners_alone",
        "test_what_is_no_key_is_refused_and_not_shown",
        "test_places_without_a_key_file",
        "test_the_verb",
    )
]

TESTS: dict[str, list[str]] = {
    "hil.verdict": ["tests/verdict/test_judge.py"],
    "hil.verdict.angle": ["tests/verdict/test_angle.py"],
    "hil.verdict.budget": ["tests/verdict/test_budget_rows.py", "tests/records/test_budget.py"],
    "hil.verdict.machine": ["tests/verdict/test_machine.py"],
    "hil.verdict.model": ["tests/verdict/test_model.py"],
    "hil.verdict.safety": ["tests/verdict/test_safety.py"],
    "estimator.uncertainty": ["tests/verdict/test_budget_rows.py", "tests/estimator/test_uncertainty.py"],
    "hil.loop.account": ["tests/loop/test_account.py"],
    "hil.loop.armed": ["tests/loop/test_armed.py"],
    "hil.loop.echo": ["tests/loop/test_echo.py"],
    "hil.loop.levels": ["tests/loop/test_levels.py"],
    "hil.loop.preflight": ["tests/loop/test_preflight.py"],
    "hil.loop.signs": ["tests/loop/test_signs.py"],
    "hil.loop.stopping": ["tests/loop/test_stopping.py"],
    "hil.loop.stops": _STOPS,
    "hil.loop.supervision": ["tests/cli/test_processes.py"],
    "hil.records.answers": ["tests/records/test_answers_by_hand.py", "tests/records/test_answer_count.py"],
    "hil.records.blocks": ["tests/records/test_stream.py", "tests/records/test_check.py"],
    "hil.records.check": ["tests/records/test_check_rules.py"],
    "hil.nees": ["tests/records/test_covariance.py"],
    "hil.wire.key_file": _KEY_FILE,
    "hil.wire.keyed": _KEYED,
    "hil.wire.session": _KEYED,
    "estimator.completeness.answer": ["tests/estimator/test_completeness.py"],
    "estimator.completeness.closing": ["tests/estimator/test_completeness.py"],
    "estimator.completeness.lacking": ["tests/estimator/test_completeness.py"],
    "estimator.completeness.turning": ["tests/estimator/test_completeness.py"],
    "estimator.gaps": ["tests/estimator/test_gaps.py"],
}
