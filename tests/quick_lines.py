"""How many lines of slow tables `make test` tries: the others are for `make test-long`.

Purpose: a table costs about two seconds of a quick run, so that all of it takes under ten minutes
on two free cores; a test of one line that takes longer is left out (0). Figures were measured:
`pytest --durations=0`, then by hand where a test is one that must always run.
Non-goals: which tests are long by their nature: the marker `long` stands beside them.
"""

QUICK = {
    "correct/test_any_order_agrees.py": {
        "the_engines_agree_in_any_order_with_any_answers": 1,
    },
    "correct/test_c_answers.py": {
        "an_answer_of_a_c_node_is_taken_alike": 2,
    },
    "correct/test_cli_end_to_end.py": {
        "ctrl_c_shows_what_was_reached": 1,
        "one_document_whatever_externs_print": 2,
    },
    "correct/test_compose_page.py": {
        "what_the_page_says_of_changes_is_so": 1,
    },
    "correct/test_contracts_hide_nothing.py": {
        "what_the_whole_violates_is_found_one_module_at_a_time": 1,
    },
    "correct/test_corner_programs.py": {
        "engines_agree": 30,
    },
    "correct/test_corridor_flights.py": {
        "the_re_checker_confirms_samples_of_every_view": 0,
    },
    "correct/test_drone_battery.py": {
        "the_battery_is_proved_and_confirmed": 0,
    },
    "correct/test_engines_agree.py": {
        "engines_agree_on_every_byte": 1,
        "engines_agree_on_inputs_from_outside": 1,
        "engines_agree_where_every_struct_is_large": 0,
    },
    "correct/test_explorer_agrees.py": {
        "they_agree_on_parts_that_share_only_time": 2,
        "they_agree_on_steps_that_take_time": 2,
        "they_agree_where_actors_fall_into_groups_within_an_instant": 6,
    },
    "correct/test_faults_agree.py": {
        "no_proof_and_no_set_is_about_faults": 0,
    },
    "correct/test_find_the_bug.py": {
        "samples_find_the_bug_and_never_say_clean": 1,
    },
    "correct/test_fleets_agree.py": {
        "a_fleet_is_what_it_is_written_out_as": 1,
    },
    "correct/test_gallery.py": {
        "right_versions_are_exhausted_and_the_page_has_the_figures": 1,
    },
    "correct/test_gallery_page.py": {
        "a_command_says_what_the_page_says": 2,
    },
    "correct/test_induction_agrees.py": {
        "nothing_is_proved_that_a_run_violates": 1,
    },
    "correct/test_leases_in_real_time.py": {
        "a_value_that_is_none_is_counted_and_not_taken": 1,
    },
    "correct/test_no_heap.py": {
        "random_programs_need_only_what_is_allowed": 1,
    },
    "correct/test_readme.py": {
        "a_command_of_the_readme_works": 1,
    },
    "correct/test_real_logs.py": {
        "a_csv_says_the_same_as_the_mcap_it_was_made_of": 1,
        "a_run_read_as_a_foreign_log_is_decided_as_it_was": 1,
    },
    "correct/test_real_time.py": {
        "an_ac_that_fails_loses_control_and_nothing_else_happens": 1,
    },
    "correct/test_resumed_after_a_cut.py": {
        "cut_by_memory": 5,
    },
    "correct/test_resumed_searches_agree.py": {
        "in_pieces_a_search_says_the_same": 1,
        "in_pieces_a_search_sees_nearly_as_soon_that_it_holds_for_ever": 1,
    },
    "correct/test_runs_of_lasting_steps.py": {
        "what_a_run_does_is_tried_by_a_test": 1,
    },
    "correct/test_sanitizers.py": {
        "programs_of_the_repository_run_clean": 1,
        "random_programs_run_clean": 1,
    },
    "correct/test_seeded_bugs.py": {
        "a_seeded_bug_is_found_by_a_least_trace": 1,
    },
    "correct/test_testing_examples.py": {
        "a_comment_that_names_a_bug_is_right": 2,
        "a_shipped_test_has_the_verdict_that_it_says": 2,
    },
    "unit/campaign/test_arms_and_saves.py": {
        "a_flight_of_an_arm_is_flown_again_bit_for_bit": 2,
    },
    "unit/cli/test_cli_apart.py": {
        "a_copy_made_in_c_tells_nothing": 1,
        "a_policy_that_ends_its_process_is_a_step_fault": 2,
        "a_second_ctrl_c_ends_code_that_hears_no_signals": 0,
        "a_signal_closes_the_log": 1,
        "one_summary_and_the_log_is_saved": 3,
        "what_both_processes_left_of_a_log_is_named_by_the_next_run": 1,
    },
    "unit/cli/test_cli_assure.py": {
        "a_certificate_of_anything_else_supports_nothing": 1,
        "tests_count_only_where_they_are_explored_now": 0,
    },
    "unit/cli/test_cli_build.py": {
        "a_program_may_be_called_like_one_of_the_files": 3,
        "the_built_command_refuses_nonsense": 3,
    },
    "unit/cli/test_cli_formats.py": {
        "verify_in_all_formats": 0,
    },
    "unit/cli/test_cli_keeps_files.py": {
        "a_log_or_report_replaces_an_older_one": 1,
    },
    "unit/cli/test_cli_real_time.py": {
        "a_policy_that_fails_takes_nothing_with_it": 1,
    },
    "unit/cli/test_cli_run.py": {
        "python_and_c_do_the_same_on_both_engines": 2,
    },
    "unit/cli/test_cli_test.py": {
        "whatever_signal_ends_it_what_was_covered_is_printed": 1,
    },
    "unit/explore/test_checkpoints.py": {
        "ended_from_outside_it_goes_on": 1,
    },
    "unit/explore/test_messages_of_a_step.py": {
        "every_message_counts": 1,
    },
    "unit/explore/test_modules_above_modules.py": {
        "explorer_and_enumerator_agree_on_a_tower": 1,
    },
    "unit/explore/test_shrinking.py": {
        "shrinking_gives_the_same_trace_twice": 0,
    },
    "unit/explore/test_slice.py": {
        "what_does_not_matter_may_choose_otherwise": 3,
    },
    "unit/explore/test_wide_steps.py": {
        "memory_bounds_what_the_process_takes": 1,
    },
    "unit/lsp/test_command.py": {
        "a_program_may_end_anywhere": 1,
    },
    "unit/lsp/test_names.py": {
        "a_program_with_another_name_is_the_same_program": 2,
    },
    "unit/lsp/test_resolve.py": {
        "every_read_leads_to_what_the_checker_reads": 4,
    },
    "unit/prelude/test_coefficients.py": {
        "constants_are_the_derived_ones": 0,
    },
    "unit/program/test_check_mutants.py": {
        "the_programs_themselves_are_sound": 3,
    },
    "unit/reach/test_braking.py": {
        "what_takes_room_away_is_no_law": 1,
    },
    "unit/reach/test_composition.py": {
        "the_convoy_is_proved_and_rechecked": 0,
    },
    "unit/reach/test_coordinated.py": {
        "a_prover_that_thinks_it_knows_the_mode_is_found_out": 1,
        "an_adversary_who_chooses_the_mode_never_leaves_what_was_proved": 0,
        "half_spaces_know_predicates_with_modes_and_no_law_with_one": 1,
        "looking_at_a_mode_is_proved_and_rechecked": 1,
        "one_who_must_come_along_comes_too_late_or_not_and_is_never_counted_on": 1,
        "waiting_for_one_that_waits_gives_no_control_back": 1,
        "what_needs_to_know_the_mode_is_not_proved": 1,
    },
    "unit/reach/test_coordinated_induction.py": {
        "a_prover_that_thinks_it_knows_the_mode_is_found_out": 1,
        "looking_at_a_mode_is_proved_and_rechecked": 1,
        "what_needs_to_know_the_mode_is_not_proved": 1,
    },
    "unit/reach/test_entered.py": {
        "a_guard_that_lets_too_much_in_is_not": 1,
        "what_is_let_in_lies_in_the_set_wherever_that_is_shown": 1,
    },
    "unit/reach/test_failsafe_limits.py": {
        "a_law_that_only_the_prover_would_claim_is_rejected": 1,
    },
    "unit/reach/test_heard_beside.py": {
        "what_is_heard_beside_is_told_and_adds_no_age": 1,
    },
    "unit/reach/test_induction.py": {
        "a_wrong_planner_is_never_proved": 1,
        "floats_are_equal_as_floats_are_and_not_as_terms": 0,
        "functions_have_names_of_their_own": 0,
        "lists_of_other_things_are_other_lists": 0,
        "progress_is_assumed_and_printed": 0,
        "what_a_node_takes_counts_as_its_response": 1,
        "what_is_opaque_is_named_and_no_assumption": 0,
        "what_is_opaque_proves_nothing_wrong": 1,
        "without_progress_nothing_says_that_ac_gets_control_back": 1,
    },
    "unit/reach/test_instances_proved.py": {
        "a_module_is_proved_with_its_own_parameters_and_the_topics_around_it": 1,
        "every_element_is_a_problem_of_its_own_and_so_says_its_certificate": 0,
    },
    "unit/reach/test_mutants.py": {
        "a_mutant_is_refuted": 1,
    },
    "unit/reach/test_recover_time.py": {
        "the_rechecker_holds_t_to_the_same_terms": 0,
    },
    "unit/reach/test_refute.py": {
        "a_bad_module_is_refuted": 3,
        "a_sound_module_is_not": 1,
    },
    "unit/reach/test_starts.py": {
        "both_starts_have_to_be_among_those_proved": 1,
    },
    "unit/reach/test_verify.py": {
        "what_is_wrong_is_not_proved": 2,
    },
    "unit/reach/test_verify_groups.py": {
        "a_finer_grid_settles_borders_and_forgets_no_failure": 0,
        "a_map_is_proved_in_steps_and_a_wrong_one_is_not": 0,
    },
    "unit/reach/test_views.py": {
        "a_certificate_in_which_a_view_stands_twice_is_rejected": 0,
        "a_certificate_without_one_of_the_views_is_rejected": 1,
        "a_predicate_in_a_view_never_says_more_than_the_whole": 0,
        "what_one_view_cannot_show_is_not_proved": 1,
        "what_only_safe_reads_is_said_to_be_judged_on_the_plant_of_the_proof": 0,
    },
    "unit/reach/test_wrong_modules.py": {
        "a_wrong_module_is_not_proved_without_a_word": 1,
        "a_wrong_module_that_was_once_proved_is_not": 1,
        "the_right_modules_that_they_are_made_from_are_proved": 1,
    },
    "unit/reach_computed/test_complete.py": {
        "sets_that_are_too_large_would_be_noticed": 0,
        "the_second_time_they_come_from_the_cache": 0,
    },
    "unit/reach_computed/test_deployed.py": {
        "half_spaces_of_all_values_are_what_polytopes_return_to": 0,
    },
    "unit/reach_computed/test_dm_check.py": {
        "one_wrong_entry_of_a_table_is_found": 0,
    },
    "unit/reach_enclose/test_module_enclosures.py": {
        "what_a_module_does_lies_in_its_enclosures": 1,
    },
    "unit/reach_grids/test_grid_sets.py": {
        "no_run_escapes_the_core": 1,
    },
    "unit/reach_grids/test_honest_modules.py": {
        "a_module_just_beyond_is_not": 1,
        "an_honest_module_is_proved": 1,
    },
    "unit/reach_grids/test_policies.py": {
        "the_way_back_takes_no_longer_than_claimed": 2,
    },
    "unit/reach_polytopes/test_polytope_adversary.py": {
        "a_hole_put_back_by_hand_is_found": 1,
        "an_sc_that_was_taken_to_be_in_time_is_found": 1,
        "nobody_leaves_k_by_timing": 1,
    },
    "unit/reach_polytopes/test_polytopes.py": {
        "sc_keeps_the_constraint_from_every_state_of_k": 1,
    },
    "unit/reach_polytopes/test_verify_polytopes.py": {
        "what_is_wrong_is_undecided": 1,
    },
    "unit/reach_undecided/test_coarse_cells.py": {
        "a_k_that_no_run_leaves_is_told_so": 0,
    },
    "unit/recheck/test_authority.py": {
        "a_delay_that_is_longer_is_what_counts": 0,
    },
    "unit/recheck/test_certificates.py": {
        "the_adversary_sees_what_is_wrong": 0,
    },
    "unit/recheck/test_deployed_tables.py": {
        "a_larger_set_with_a_table_that_fits_is_rejected": 1,
    },
    "unit/recheck/test_local_certificates.py": {
        "nothing_false_is_accepted_of_what_was_changed": 0,
        "one_more_cell_is_rejected": 1,
    },
    "unit/recheck/test_local_chains.py": {
        "chains_enclose_runs": 9,
    },
    "unit/recheck/test_polytope_bounds.py": {
        "no_run_ends_a_hold_beyond_its_bounds": 1,
    },
    "unit/recheck/test_polytope_certificates.py": {
        "a_half_space_of_k_that_is_moved_out_is_rejected": 0,
        "a_prover_with_a_hole_is_caught": 1,
        "what_overstates_is_rejected": 8,
        "what_overstates_predicates_is_rejected": 0,
        "what_the_prover_writes_is_accepted": 1,
    },
    "unit/recheck/test_recheck_induction.py": {
        "a_manifest_made_wrong_is_rejected": 1,
        "a_program_made_wrong_is_rejected": 1,
        "more_than_is_proved_of_what_is_opaque_is_rejected": 0,
        "wrong_programs_of_what_is_opaque_are_rejected": 1,
    },
    "unit/recheck/test_what_machines_compute.py": {
        "what_is_proved_with_truths_and_tables_is_accepted": 1,
    },
    "unit/report/test_report_html.py": {
        "a_browser_draws_every_figure": 1,
    },
    "unit/runtime/test_channel.py": {
        "the_driver_is_clean_under_sanitizers": 1,
    },
    "unit/simulate/test_simulate_rounding.py": {
        "linked_c_that_rounds_otherwise_ends_the_run": 1,
    },
    "unit/syntax/test_syntax_grammar.py": {
        "grammar_accepts_what_it_generates": 0,
    },
    "unit/syntax/test_syntax_hostile.py": {
        "diagnostics_of_hostile_text_can_be_shown": 10,
        "hostile_text_is_answered_quickly": 7,
    },
    "unit/syntax/test_syntax_printer.py": {
        "sample_files_keep_tree_and_comments": 19,
    },
    "unit/targets/test_leases.py": {
        "flights_of_the_emergency_stop_stay_between_the_walls_with_leases_only": 0,
    },
    "unit/targets/test_package_layout.py": {
        "a_command_is_never_called_like_a_file_or_goal_of_its_package": 2,
    },
    "unit/test_long_tests.py": {
        "what_is_left_out_is_told": 1,
    },
}
"""File below tests/ -> the name of a test, without `test_` -> lines of its table."""
