"""Which tests belong to which module: those that say what it promises, and take seconds.

`hil.running.supervision` is not here: what it promises is about processes that die, and its tests take real time. Name
them with `--tests` and `--slow`.
"""

_STOPS = ["tests/running/test_armed.py", "tests/verdict/test_safety.py"]
_KEYED = ["tests/wire/test_sessions.py", "tests/wire/test_keyed.py::test_the_counter_ends_and_does_not_wrap"]
_BLOCKS = [
    "tests/records/test_check_rules.py",
    "tests/records/test_replay_pieces.py",
    *(
        f"tests/records/test_stream.py::{name}"
        for name in (
            "test_what_was_written_is_read",
            "test_a_file_cut_inside_its_header_is_refused",
            "test_a_missing_block_is_told",
            "test_a_block_of_another_record_is_told",
            "test_a_record_without_checksums_is_refused_in_one_line",
            "test_a_part_is_what_the_whole_has_there",
            "test_what_is_no_record_is_refused",
            "test_an_arrow_stream_from_elsewhere_is_refused",
            "test_another_kind_and_a_newer_version_are_refused",
            "test_a_file_that_is_not_there_is_refused",
            "test_a_writer_whose_body_raised_leaves_no_end_marker",
        )
    ),
]
_CLOSING = ["tests/estimator/test_closing_rules.py", "tests/estimator/test_completeness.py"]
_KEY_FILE = [
    "tests/wire/test_key_files.py",
    *(
        f"tests/wire/test_keyed.py::{name}"
        for name in (
            "test_a_key_file_is_its_owners_alone",
            "test_what_is_no_key_is_refused_and_not_shown",
            "test_places_without_a_key_file",
        )
    ),
]


_SIGNS = [
    f"tests/running/test_signs.py::{name}"
    for name in (
        "test_other_signs_have_to_predict_well_and_the_declared_ones_far_worse",
        "test_an_observer_that_is_lost_at_a_single_row_predicts_nothing",
        "test_only_signs_of_axes_that_were_driven_are_tried",
        "test_a_record_without_a_sample_after_the_first_drive_tells_nothing",
        "test_it_reads_forty_cycles_and_at_most_twenty_thousand_samples",
        "test_two_samples_are_looked_at_and_one_is_not",
    )
]


_IDENTIFICATION = {
    "angle": "angle",
    "pool": "pool",
    "pool_trace": "pool",
    "pooled": "pool",
    "pooled_layout": "pool",
    "examination": "examination angle",
    "fitness": "fitness_rules fitness rest",
    "prediction": "prediction free_runs_of_a_ring_down",
    "problem": "problem",
    "start": "start",
    "start_values": "start_values watch_list rings",
    "symmetries": "symmetries",
}
_COMPLETENESS = {"turning": "completeness angle_sensitivity"}
_SHARED = {
    "diagnosis": "promised closed_forms",
    "record": "promised closed_forms",
    "thresholds": "thresholds",
}
_RESIDUAL = {
    "analysis": "residual residual_findings closed_forms",
    "floor": "residual_measures residual",
    "significance": "residual_measures residual",
    "spectrum": "residual_measures residual closed_forms",
    "whiteness": "residual_measures residual closed_forms",
}
_RATE_SENSOR = (
    *("catalogue", "chain", "characteristic", "declaration", "dynamics", "record", "surroundings"),
    "trace",
)

_WIRE = {
    "can_adapter": "wire/test_adapter wire/test_datagram_links wire/test_wire_log",
    "can_format": "wire/test_can_format wire/test_datagram_links",
    "can_link": "wire/test_can_kernel wire/test_datagram_links",
    "claim": "wire/test_small_promises",
    "client": "wire/test_waiting wire/test_endpoint wire/test_small_promises wire/test_light",
    "codec": "wire/test_codec wire/test_golden wire/test_stream",
    "datagram_link": "wire/test_datagrams wire/test_datagram_links",
    "endpoint": "wire/test_endpoint wire/test_keeping",
    "fd_link": "wire/test_ports wire/test_small_promises wire/test_links",
    "frame_format": "wire/test_can_format wire/test_framing wire/test_golden",
    "framing": "wire/test_framing wire/test_golden wire/test_corpus",
    "inproc": "wire/test_endpoint wire/test_links wire/test_light",
    "link": "wire/test_ports wire/test_endpoint",
    "links": "wire/test_links wire/test_datagram_links wire/test_light",
    "messages": "wire/test_codec wire/test_golden wire/test_sense wire/test_endpoint",
    "pty_link": "wire/test_ports wire/test_links",
    "sense": "wire/test_sense wire/test_codec wire/test_golden",
    "serial_format": "wire/test_small_promises wire/test_framing wire/test_corpus wire/test_conformance",
    "serial_link": "wire/test_ports wire/test_links",
    "spec": "wire/test_spec wire/test_codec wire/test_small_promises wire/test_golden",
    "stamp": "wire/test_small_promises wire/test_datagrams",
    "stream": "wire/test_stream wire/test_sessions",
    "udp_link": "wire/test_udp wire/test_datagram_links",
    "wire_log": "wire/test_waiting wire/test_wire_log",
}


def _of_estimator(tests: str) -> list[str]:
    files = [name.partition("::") for name in tests.split()]
    return [f"tests/estimator/test_{name}.py{mark}{test}" for name, mark, test in files]


TESTS: dict[str, list[str]] = {
    "hil.verdict": ["tests/verdict/test_judge.py"],
    "hil.verdict.angle": ["tests/verdict/test_angle.py"],
    "hil.verdict.budget": ["tests/verdict/test_budget_rows.py", "tests/records/test_budget.py"],
    "hil.verdict.machine": ["tests/verdict/test_machine.py"],
    "hil.verdict.model": ["tests/verdict/test_model.py"],
    "hil.verdict.safety": ["tests/verdict/test_safety.py"],
    "estimator.uncertainty": ["tests/verdict/test_budget_rows.py", "tests/estimator/test_uncertainty.py"],
    "hil.running.account": ["tests/running/test_account.py"],
    "hil.running.armed": ["tests/running/test_armed.py"],
    "hil.running.echo": ["tests/running/test_echo.py"],
    "hil.running.turn": ["tests/running/test_turn.py"],
    "hil.running.levels": ["tests/running/test_levels.py"],
    "hil.running.preflight": ["tests/running/test_preflight.py"],
    "hil.running.signs": _SIGNS,
    "hil.running.stopping": ["tests/running/test_stopping_clock.py"],
    "hil.running.safety": _STOPS,
    "hil.records.answers": ["tests/records/test_answers_by_hand.py", "tests/records/test_answer_count.py"],
    "hil.records.blocks": _BLOCKS,
    "hil.records.check": ["tests/records/test_check_rules.py"],
    "hil.scoring.nees": ["tests/records/test_covariance.py"],
    **{f"hil.wire.{module}": [f"tests/{name}.py" for name in tests.split()] for module, tests in _WIRE.items()},
    "hil.wire.key_file": _KEY_FILE,
    "hil.wire.keyed": _KEYED,
    "hil.wire.session": _KEYED,
    "estimator.completeness.answer": _CLOSING,
    "estimator.completeness.closing": _CLOSING,
    "estimator.completeness.lacking": _CLOSING,
    "estimator.completeness.turning": _CLOSING,
    "estimator.gaps": ["tests/estimator/test_gaps.py"],
    **{f"estimator.{module}": _of_estimator(tests) for module, tests in _SHARED.items()},
    **{
        f"estimator.trace.{module}": [f"tests/trace/test_{name}.py" for name in tests.split()]
        for module, tests in _IDENTIFICATION.items()
    },
    **{f"estimator.completeness.{module}": _of_estimator(tests) for module, tests in _COMPLETENESS.items()},
    **{f"estimator.residual.{module}": _of_estimator(tests) for module, tests in _RESIDUAL.items()},
    **{
        f"estimator.rate_sensor.{module}": [
            f"tests/rate_sensor/test_{name}.py" for name in ("pieces", "chain", "trace")
        ]
        for module in _RATE_SENSOR
    },
    **{f"estimator.allan.{module}": ["tests/allan/test_deviation.py"] for module in ("deviation", "noise")},
}
