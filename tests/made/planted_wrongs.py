"""Wrong runs, files and participants, each with the test that plants it.

Each of these tests plants its wrong and checks that it is named, and that exit code or outcome
state it, or that it has no effect. A wrong that passes as good belongs here, with a new test.
"""

RUNS, RESULTS, CLI = "scenarios/runs", "scenarios/results", "scenarios/cli"
PROCESSES, ACCOUNT = f"{RUNS}/processes", f"{RESULTS}/channel/test_link_account.py"
LINKS = f"{RESULTS}/channel/test_links.py"
UNJUDGED, CONDUCTOR = f"{RESULTS}/limits/test_unjudged.py", f"{PROCESSES}/test_conductor.py"
MEMBERS, CLOCKS = f"{PROCESSES}/test_membership.py", f"{PROCESSES}/test_clock_sync.py"
VEHICLE, LAUNCHER = f"{PROCESSES}/test_vehicle_process.py", f"{PROCESSES}/test_launcher.py"
CONTROL, ENGINE = f"{RUNS}/control/test_live_control.py", "scenarios/studies/engine"
ZENOH, WRITER = "transport/bus/test_zenoh_bus.py", "transport/log/test_writer.py"
DAMAGED, CALLS = f"{CLI}/test_damaged_logs.py", f"{CLI}/test_failing_calls.py"

WRONGS = {
    # Holes and messages that do not arrive
    "4 s of true poses missing under limits":
        f"{UNJUDGED}::test_limits_over_four_missing_seconds_are_not_judged",
    "the last second missing": f"{UNJUDGED}::test_the_last_second_is_a_hole_too",
    "events that began in a hole": f"{UNJUDGED}::test_events_that_began_in_a_hole_have_an_interval",
    "messages that never arrive": f"{ACCOUNT}::test_loss_is_the_share_of_sent_messages",
    "a slow network taken for a slow machine":
        f"{LINKS}::test_a_slow_network_is_not_blamed_on_the_machine",
    "late messages that hide a delay":
        f"{LINKS}::test_latency_is_that_until_a_message_can_be_used",
    "verdicts that contradict the account":
        f"{ACCOUNT}::test_verdicts_that_contradict_the_account_fail_the_run",
    "messages out of order":
        "transport/links/test_inbox.py::test_deliveries_do_not_depend_on_the_order_of_arrival",
    "a router frozen for 4 s":
        f"{ZENOH}::test_a_router_frozen_for_four_seconds_loses_nothing_and_nobody",
    "a router lost in the last second":
        f"{CONDUCTOR}::test_a_history_has_its_lines_reason_and_end",
    # Participants
    "another source tree of the same version":
        f"{MEMBERS}::test_a_vehicle_of_another_program_is_refused",
    "another controller module": f"{MEMBERS}::test_a_vehicle_with_another_controller_is_refused",
    "another recorded drive of the same name":
        f"{MEMBERS}::test_a_vehicle_with_another_recorded_drive_is_refused",
    "other versions of Python and NumPy":
        f"{MEMBERS}::test_other_versions_of_python_and_numpy_are_a_warning",
    "a vehicle or recorder that is there twice":
        f"{MEMBERS}::test_a_second_of_one_name_is_refused_and_the_first_stays",
    "the token of a stranger": f"{MEMBERS}::test_a_stranger_s_token_stops_nobody",
    "a stranger as the recorder of a started run":
        f"{VEHICLE}::test_a_stranger_does_not_follow_the_recorder_of_a_started_run",
    "an end of another run": f"{VEHICLE}::test_only_the_recorder_of_the_run_ends_it",
    "a start of another run": f"{VEHICLE}::test_only_the_recorder_of_the_run_starts_it",
    "an answer of a clock to another query":
        f"{CLOCKS}::test_an_answer_to_another_query_measures_nothing",
    "a host that is cut off for good":
        f"{ACCOUNT}::test_a_vehicle_that_was_cut_off_for_good_is_named",
    "messages in the name of the run":
        f"{RUNS}/test_recorder.py::test_no_other_process_sends_for_the_run",
    "poses with impossible numbers":
        "transport/links/test_gate.py::test_numbers_that_no_vehicle_measures_are_absurd",
    "wrong credentials": f"{ZENOH}::test_wrong_credentials_are_not_a_missing_router",
    "a round trip of 2 s":
        f"{ZENOH}::test_processes_join_and_get_answers_over_long_round_trips",
    "a vehicle that was cut off and returns":
        f"{CONDUCTOR}::test_a_cut_off_vehicle_is_told_from_a_failed_one_and_its_return_reported",
    "a controller that raises or returns NaN":
        f"{RUNS}/node/test_fault.py::test_a_controller_that_fails_in_mid_run_fails_the_run",
    # Clocks, pauses and overload
    "clocks off by 5 s, -40 ms or 300 ms":
        f"{CLOCKS}::test_a_wrong_clock_is_corrected_before_the_start",
    "a clock that drifts by 500 ppm":
        f"{CLOCKS}::test_a_drifting_clock_stays_within_a_few_milliseconds",
    "a clock that is set during the run":
        "transport/test_clock.py::test_a_step_of_the_system_clock_changes_nothing",
    "a clock that is known too inexactly":
        "system/test_identity.py::test_a_run_does_not_start_while_a_clock_is_uncertain",
    "a recorder that was suspended for 12 s":
        f"{CONDUCTOR}::test_a_recorder_that_was_suspended_waits_for_the_vehicles_to_return",
    "a recorder of an overloaded machine":
        f"{VEHICLE}::test_a_recorder_that_catches_up_is_waited_for_as_long_as_it_gives_signs",
    "a recorder killed after its log was complete":
        f"{LAUNCHER}::test_the_outcome_is_that_of_the_recorder_that_completed_its_run",
    "a lock taken in a signal handler":
        f"{RUNS}/test_stop.py::test_signal_handlers_set_flags_and_nothing_else",
    # Live changes
    "two commands within one tick":
        f"{CONTROL}::test_all_vehicles_make_the_same_changes_in_the_same_order",
    "a change that only some vehicles can make":
        f"{CONTROL}::test_an_impossible_instant_is_refused_with_a_possible_one",
    # Writing
    "a log truncated while it is written":
        f"{WRITER}::test_a_log_that_is_truncated_while_it_is_written_is_an_error",
    "a log moved away during the run":
        f"{WRITER}::test_a_log_that_was_removed_is_missed_at_the_next_flush",
    "a full disk": f"{CLI}/test_cli.py::test_a_run_on_a_full_disk_fails_with_a_line_and_a_log",
    "an error or short write of any file call":
        f"{CALLS}::test_promised_files_are_on_the_disk_or_the_command_fails",
    "a picture file that cannot be written":
        f"{CALLS}::test_a_recording_that_cannot_be_written_fails_the_command",
    "a repair that fails":
        "transport/log/test_repair.py::test_a_repair_that_fails_destroys_nothing",
    "a standard error that cannot be written":
        f"{CLI}/test_output.py::test_a_real_time_run_is_complete_with_any_output",
    "an output that nobody reads":
        f"{CLI}/test_output.py::test_a_run_ends_whose_errors_nobody_reads",
    # Logs as input
    "a flipped bit in a log used as a channel":
        f"{DAMAGED}::test_a_part_of_a_log_is_no_channel_unless_requested",
    "a damaged or interrupted log made a scenario":
        f"{DAMAGED}::test_a_part_of_a_log_makes_no_scenario_unless_requested",
    "a replayed vehicle of a damaged log": f"{DAMAGED}::test_a_part_of_a_log_replays_no_vehicle",
    "damage that a report leaves out":
        f"{DAMAGED}::test_commands_name_faults_in_a_line_and_in_their_json",
    "a piece of a log cut out or copied":
        f"{DAMAGED}::test_a_chunk_that_was_cut_out_or_copied_is_damage",
    "two logs in one file": f"{DAMAGED}::test_two_logs_in_one_file_are_damage",
    "a summary of a newer format":
        "golden/test_generations.py::test_a_summary_of_a_newer_format_is_refused",
    # Studies
    "a study resumed with other sources or options":
        f"{ENGINE}/test_journal.py::test_another_study_is_refused_with_the_differences",
    "a sweep resumed with another controller or file":
        "scenarios/studies/many/sweeps/test_sweep.py"
        "::test_a_changed_controller_or_file_is_another_sweep",
    "a worker with another version":
        f"{ENGINE}/test_engine.py"
        "::test_a_worker_with_other_versions_runs_nothing_and_names_the_differences",
    "a worker with another controller":
        f"{ENGINE}/test_engine.py::test_a_worker_with_another_controller_runs_nothing",
}  # fmt: skip
