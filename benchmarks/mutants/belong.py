"""Which tests belong to which module: those that say what it promises, and take seconds.

`hil.loop.supervision` is not here: what it promises is about processes that die, and its tests take real time. Name
them with `--tests` and `--slow`.
"""

_STOPS = ["tests/loop/test_armed.py", "tests/verdict/test_safety.py"]
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
            "test_a_record_from_before_there_were_checksums_is_read_and_known_as_such",
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
    f"tests/loop/test_signs.py::{name}"
    for name in (
        "test_other_signs_have_to_predict_well_and_the_declared_ones_far_worse",
        "test_an_observer_that_is_lost_at_a_single_row_predicts_nothing",
        "test_only_signs_of_axes_that_were_driven_are_tried",
        "test_of_a_record_without_a_single_sample_after_the_first_drive_nobody_can_tell",
        "test_forty_cycles_after_acquisition_are_looked_at_but_no_more_than_twenty_thousand_samples",
        "test_two_samples_are_looked_at_and_one_is_not",
    )
]


_TRACE = {
    "angle": "certainty",
    "by_simulation": "by_simulation by_simulation_rules",
    "candidates": "candidates watch_list",
    "certainty": "certainty",
    "claims": "claims certainty",
    "conflict": "conflict",
    "constancy": "constancy",
    "criterion": "criterion",
    "determined": "determined closed_forms",
    "dispersion": "dispersion rivals",
    "engine": "engine promised by_simulation",
    "evidence": "evidence width scan closed_forms",
    "examination": "examination certainty closed_forms",
    "fitness": "fitness_rules fitness",
    "fitting": "passes fitting certainty closed_forms",
    "free_response": "free_response closed_forms",
    "free_run": "promised free_run closed_forms",
    "free_run_model": "by_simulation free_run_model",
    "judgement": "judgement",
    "kin": "width",
    "longer": "longer",
    "look": "look candidates",
    "nameless": "nameless_pieces closed_forms nameless",
    "nested": "nested",
    "observer_model": "observer_model certainty",
    "parameters": "hill closed_forms parameters",
    "pool.fit": "pool",
    "pool.members": "pool",
    "pool.model": "pool",
    "pool.trace": "pool",
    "prediction": "prediction fitting",
    "prediction_error": "prediction_error",
    "probability": "probability rivals closed_forms",
    "problem": "problem",
    "promises": "promises promised conflict closed_forms",
    "rest": "rest judgement",
    "rings": "rings",
    "rivals": "rivals closed_forms",
    "same_number": "same_number",
    "scan": "scan scan_parts angle_sensitivity",
    "screening": "screening",
    "searched": "same_number certainty",
    "selection": "selection",
    "separation": "separation",
    "sidebands": "sidebands",
    "start": "start fitting closed_forms",
    "symmetries": "symmetries",
    "tracing": "promised answer",
    "ways": "ways",
    "width": "width",
}
_SHARED = {
    "diagnosis": "promised closed_forms",
    "record": "certainty promised closed_forms",
    "thresholds": "thresholds threshold_screening",
    "thresholds_page": "thresholds closed_forms",
}
_RESIDUAL = {
    "analysis": "residual residual_findings closed_forms",
    "demodulation": "residual residual_measures closed_forms",
    "dependence": "residual_measures residual closed_forms",
    "effective": "judgement determined",
    "floor": "residual_measures residual",
    "significance": "residual_measures residual",
    "spectrum": "residual_measures residual closed_forms",
    "suspects": "residual",
    "whiteness": "residual_measures residual closed_forms",
}
_RATE_SENSOR = (
    *("catalogue", "chain_model", "characteristic", "declaration", "dynamics", "model", "record", "surroundings"),
    "trace",
)

_WIRE = {
    "generate.c_header": "firmware/test_spec wire/test_golden wire/test_generators",
    "can_adapter": "wire/test_adapter wire/test_datagram_links wire/test_wire_log",
    "can_format": "wire/test_can_format wire/test_datagram_links",
    "can_link": "wire/test_can_kernel wire/test_datagram_links",
    "claim": "wire/test_small_promises",
    "client": "wire/test_waiting wire/test_endpoint wire/test_small_promises wire/test_light",
    "codec": "wire/test_codec wire/test_golden wire/test_stream",
    "datagram_link": "wire/test_datagrams wire/test_datagram_links",
    "generate.dbc": "firmware/test_dbc wire/test_spec wire/test_generators",
    "generate.docs": "wire/test_docs wire/test_generators",
    "endpoint": "wire/test_endpoint wire/test_keeping",
    "fd_link": "wire/test_ports wire/test_small_promises wire/test_links",
    "frame_format": "wire/test_can_format wire/test_framing wire/test_golden",
    "framing": "wire/test_framing wire/test_golden wire/test_corpus",
    "generate.golden": "wire/test_golden wire/test_generators",
    "inproc": "wire/test_endpoint wire/test_links wire/test_light",
    "generate.keyed_page": "wire/test_keyed wire/test_docs",
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


_ORACLES = "blocks::test_estimates_are_the_oracles blocks::test_forgetting_in_haste_and_recalling_are_the_oracles"
_FOLLOWED = (
    "scan_pieces::test_equations_and_angle_move_as_if_the_effect_were_carried"
    " scan_pieces::test_both_kernels_follow_alike_through_uneven_steps_and_warmth"
)
_LINE = "observer::test_a_line_is_compensated_in_the_middle_of_the_interval_its_force_acts_on"
_KERNEL = {
    "angle": "control_pieces",
    "angle_error": "control_pieces filter_pieces blocks::test_estimates_are_the_oracles",
    "block": " ".join(
        f"blocks::{name}"
        for name in (
            "test_a_late_path_finds_the_drives_of_the_intervals_before",
            "test_every_few_samples_the_state_as_it_is_then",
            "test_a_block_ends_with_its_last_sample_and_not_with_the_last_state_that_is_kept",
            "test_what_is_not_estimated_has_no_deviation_and_stays",
            "test_a_tick_is_a_block_of_one_sample",
            "test_a_tick_answers_with_the_command_for_its_sample",
            "test_a_drive_is_turned_by_the_virtual_rotation_while_it_acts",
            "test_warmth_reaches_the_effects_that_move_with_it",
            "test_from_its_reference_on_an_angle_is_counted_from_a_value_that_is_exact",
        )
    )
    + " observer::test_queue_tells_what_the_board_will_have_applied",
    "controller": f"control_pieces filter_pieces {_LINE}",
    "experiment": "scan_pieces::test_an_experiment_is_the_model_under_the_drive_that_an_observer_asks_for",
    "flow": "flow_pieces blocks::test_warmth_reaches_the_effects_that_move_with_it"
    " hysteresis::test_a_way_slides_it_as_its_equation_says_and_back"
    " hysteresis::test_against_the_motion_a_slip_moves_as_the_mass_does"
    " hysteresis::test_along_the_motion_a_slip_is_that_of_its_equation"
    " play::test_the_force_along_a_cycle_encloses_the_closed_form_and_that_of_the_foot_alone_would_drive"
    " model::test_flow_is_that_of_an_integrator"
    " effects::test_jacobian_of_friction_is_that_of_an_integrator"
    " effects::test_a_late_drive_is_the_recorded_one_moved effects::test_a_late_sense_path_shows_what_was"
    " effects::test_a_late_sense_path_shows_what_a_spring_did_on_the_way"
    " effects::test_a_large_effect_is_followed_beyond_what_its_coefficient_is_known_to",
    "foresight": "foresight",
    "gain_matrix": "gain_matrix::test_the_loop_has_the_frequencies_that_were_asked_for"
    " gain_matrix::test_holds_are_in_it_and_no_faster_than_the_host gain_matrix::test_offsets_cause_no_force",
    "generated.step": f"{_ORACLES} observer::test_codes_are_volts_of_their_own_channel"
    " blocks::test_a_tick_is_a_block_of_one_sample"
    " scan_pieces::test_both_kernels_follow_alike_with_a_course_in_two_blocks",
    "gram": "filter_pieces",
    "observer": f"filter_pieces {_ORACLES} blocks::test_one_axis_is_the_oracles"
    " effects::test_measurement_and_its_jacobian effects::test_a_late_sense_path_shows_what_was",
    "pattern": "control_pieces filter_pieces",
    "scan": f"{_FOLLOWED} scan_pieces::test_samples_around_a_jump_count_less"
    " scan_pieces::test_the_course_is_kept_at_equal_distances"
    " scan_pieces::test_an_impulse_leaves_at_the_end_what_the_matrix_exponential_says"
    " scan_pieces::test_rows_and_pulls_are_products"
    " scan_pieces::test_what_followed_forces_push_is_their_integral_along_the_motion"
    " scan_pieces::test_what_followed_effects_show_is_taken_off_with_its_sign"
    " scan_pieces::test_a_turn_is_the_gradient_along_what_is_followed"
    " scan_pieces::test_a_pattern_that_is_none_has_no_gradient"
    " scan_pieces::test_recalling_pulls_along_what_is_followed",
    "scan_plain": f"{_FOLLOWED} scan_pieces::test_samples_around_a_jump_count_less",
    "sensing": "sensing::test_a_channel_shows_the_equation_at_any_one_state"
    " sensing::test_rows_of_two_axes_beside_effects_of_the_velocity_are_those_of_differences",
    "signals": "signal_pieces control_pieces "
    + " ".join(
        f"effects::test_{name}"
        for name in (
            "a_drive_behind_a_lag_is_that_of_an_integrator",
            "a_low_pass_is_the_filter_behind_the_mass",
            "a_drive_integrated_with_a_leak_is_that_of_an_integrator",
            "a_resonator_follows_its_equation",
            "friction_is_followed_through_turning_points",
        )
    ),
    "simulation": "signal_pieces::test_a_free_run_keeps_the_time_of_forces_and_of_what_is_sensed"
    " simulation::test_a_driven_single_axis_with_effects_runs_as_an_independent_integrator_says"
    " simulation::test_derivatives_are_those_of_differences"
    " simulation::test_a_channel_of_velocity_or_acceleration_shows_that",
    "stationary": "control_pieces::test_the_ideal_orbit_is_held_by_the_holding_force"
    " control_pieces::test_gains_are_gathered_at_the_nearest_angle_and_phase"
    " blocks::test_a_gain_of_the_table_is_that_of_a_filter_held_on_the_orbit",
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
    "hil.loop.account": ["tests/loop/test_account.py"],
    "hil.loop.armed": ["tests/loop/test_armed.py"],
    "hil.loop.echo": ["tests/loop/test_echo.py"],
    "hil.loop.turn": ["tests/loop/test_turn.py"],
    "hil.loop.levels": ["tests/loop/test_levels.py"],
    "hil.loop.preflight": ["tests/loop/test_preflight.py"],
    "hil.loop.signs": _SIGNS,
    "hil.loop.stopping": ["tests/loop/test_stopping_clock.py"],
    "hil.loop.stops": _STOPS,
    "hil.records.answers": ["tests/records/test_answers_by_hand.py", "tests/records/test_answer_count.py"],
    "hil.records.blocks": _BLOCKS,
    "hil.records.check": ["tests/records/test_check_rules.py"],
    "hil.nees": ["tests/records/test_covariance.py"],
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
    **{f"estimator.kernel.{module}": _of_estimator(tests) for module, tests in _KERNEL.items()},
    **{f"estimator.trace.{module}": _of_estimator(tests) for module, tests in _TRACE.items()},
    **{f"estimator.residual.{module}": _of_estimator(tests) for module, tests in _RESIDUAL.items()},
    **{
        f"estimator.rate_sensor.{module}": [
            f"tests/rate_sensor/test_{name}.py" for name in ("pieces", "chain", "trace")
        ]
        for module in _RATE_SENSOR
    },
    **{f"estimator.rate_sensor.{module}": ["tests/rate_sensor/test_allan.py"] for module in ("allan", "noise")},
}
