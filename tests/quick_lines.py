"""How many lines of slow tables `make test` tries: the others are for `make test-long`.

Purpose: a table costs a second or two of a quick run, so that all of it takes about ten minutes
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
        "the_module_that_waits_is_that_of_the_example_and_proved_as_the_page_says": 0,
        "the_table_of_the_page_is_printed": 0,
        "what_the_page_says_of_changes_is_so": 0,
    },
    "correct/test_contracts_hide_nothing.py": {
        "explorer_and_enumerator_agree_on_what_stands_for_modules": 0,
        "what_the_whole_violates_is_found_one_module_at_a_time": 1,
    },
    "correct/test_corner_programs.py": {
        "a_program_may_have_any_name": 4,
        "engines_agree": 1,
    },
    "correct/test_corridor_flights.py": {
        "a_box_is_entered_inside_of_its_s0_only": 1,
        "a_box_that_is_entered_anywhere_is_left": 0,
        "the_re_checker_confirms_samples_of_every_view": 0,
    },
    "correct/test_deployed_order.py": {
        "explorer_and_enumerator_agree_on_the_deployed_order": 1,
    },
    "correct/test_drone_battery.py": {
        "a_battery_without_reserve_is_not_proved": 1,
        "the_battery_is_proved_and_confirmed": 0,
    },
    "correct/test_drone_design.py": {
        "the_residual_stays_below_what_the_sets_assume": 0,
    },
    "correct/test_drone_figures.py": {
        "each_figure_is_a_page_with_the_numbers_that_were_printed": 1,
    },
    "correct/test_drone_mission.py": {
        "a_liars_plans_are_turned_down_each_for_a_reason_of_the_program": 0,
        "plans_are_kept_as_they_came_into_force": 0,
        "the_samples_are_the_runs_states": 0,
    },
    "correct/test_drone_planner.py": {
        "each_bug_shows_and_is_refused": 5,
        "whatever_the_planner_publishes_the_roadmap_plans_on": 3,
    },
    "correct/test_drone_stack.py": {
        "a_landing_is_flown_by_sc_alone": 0,
        "a_landing_that_ac_may_fly_is_not_over_in_time": 0,
        "the_battery_is_proved_where_everything_flies": 0,
    },
    "correct/test_drone_wrong.py": {
        "a_stack_that_breaks_an_assumption_is_proved_and_says_so": 0,
        "a_wrong_stack_is_not_proved_and_a_flight_shows_why": 0,
        "the_unbroken_stack_is_proved_and_flies_on_in_the_same_worlds": 0,
    },
    "correct/test_dynamic_errors.py": {
        "a_program_goes_wrong_at_run_time_as_it_says": 6,
    },
    "correct/test_engines_agree.py": {
        "engines_agree_on_every_byte": 1,
        "engines_agree_on_inputs_from_outside": 1,
        "engines_agree_where_every_struct_is_large": 0,
        "the_printer_keeps_the_meaning": 0,
    },
    "correct/test_equal_instances_agree.py": {
        "equal_instances_are_stored_once": 1,
    },
    "correct/test_explorer_agrees.py": {
        "explorer_and_enumerator_agree": 1,
        "parts_of_a_system_share_time": 1,
        "they_agree_on_instances_with_parameters_and_wires": 1,
        "they_agree_on_parts_that_share_only_time": 1,
        "they_agree_on_steps_that_take_time": 1,
        "they_agree_where_actors_fall_into_groups_within_an_instant": 1,
        "what_is_compared_determines_the_future": 0,
    },
    "correct/test_externs_agree.py": {
        "engines_agree_whatever_python_answers": 1,
    },
    "correct/test_faults_agree.py": {
        "a_fault_is_seen": 2,
        "a_node_that_always_overruns_is_one_that_takes_so_long": 1,
        "both_engines_do_the_same": 1,
        "both_engines_do_the_same_where_steps_take_time": 1,
        "no_proof_and_no_set_is_about_faults": 0,
        "what_a_step_that_lasts_publishes_counts_so_much_later": 2,
    },
    "correct/test_find_the_bug.py": {
        "every_option_of_the_page_gives_the_same_answer": 1,
        "samples_find_the_bug_and_never_say_clean": 1,
        "the_arithmetic_of_the_page": 1,
        "the_sled_gets_far_by_plans_and_not_by_chance": 0,
    },
    "correct/test_firmware.py": {
        "the_stack_that_is_used_is_within_the_bound_and_not_far_from_it": 1,
    },
    "correct/test_fleets_agree.py": {
        "a_fleet_is_what_it_is_written_out_as": 1,
    },
    "correct/test_gallery.py": {
        "a_right_version_with_one_line_changed_is_violated": 2,
        "right_versions_are_exhausted_and_the_page_has_the_figures": 1,
        "two_robots_with_one_line_changed_are_violated": 2,
    },
    "correct/test_gallery_page.py": {
        "a_command_says_what_the_page_says": 2,
    },
    "correct/test_induction_agrees.py": {
        "nothing_is_proved_that_a_run_violates": 1,
    },
    "correct/test_language_examples.py": {
        "an_example_checks_clean_and_runs_alike_on_both_engines": 3,
    },
    "correct/test_large_values.py": {
        "both_engines_have_the_same_bytes": 2,
    },
    "correct/test_model_monitor.py": {
        "parameters_are_read_off_the_topics_where_there_are_no_true_states": 0,
        "the_drone_with_a_quarter_of_the_wind_declared_raises_alarms": 0,
    },
    "correct/test_mountain_car.py": {
        "a_safe_controller_that_pushes_left_is_not_proved": 0,
    },
    "correct/test_no_heap.py": {
        "random_programs_need_only_what_is_allowed": 1,
    },
    "correct/test_other_machines.py": {
        "the_cart_has_the_same_trace": 1,
    },
    "correct/test_programs.py": {
        "a_correct_program_runs_alike_on_both_engines": 7,
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
        "restarts_are_bounded": 0,
    },
    "correct/test_resumed_after_a_cut.py": {
        "cut_by_memory": 5,
        "cut_by_time": 3,
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
        "a_comment_that_names_a_bug_is_right": 1,
        "a_shipped_test_has_the_verdict_that_it_says": 1,
    },
    "unit/api/test_api_prepared.py": {
        "a_run_is_the_same_whatever_ran_before_it": 1,
    },
    "unit/api/test_shown.py": {
        "a_notebook_shows_the_report_of_a_proof_inline": 0,
    },
    "unit/campaign/test_arms_and_saves.py": {
        "a_flight_of_an_arm_is_flown_again_bit_for_bit": 2,
    },
    "unit/campaign/test_campaign.py": {
        "killed_it_goes_on_and_loses_nothing": 0,
    },
    "unit/campaign/test_ray.py": {
        "the_c_of_externs_is_sent": 0,
    },
    "unit/cli/test_cli_apart.py": {
        "a_copy_made_in_c_tells_nothing": 1,
        "a_policy_that_ends_its_process_is_a_step_fault": 2,
        "a_second_ctrl_c_ends_code_that_hears_no_signals": 0,
        "a_signal_closes_the_log": 1,
        "one_summary_and_the_log_is_saved": 1,
        "what_both_processes_left_of_a_log_is_named_by_the_next_run": 0,
    },
    "unit/cli/test_cli_assure.py": {
        "what_a_certificate_does_not_prove_is_not_supported": 2,
        "tests_count_only_where_they_are_explored_now": 0,
        "the_document_of_strictdoc_names_every_parent": 0,
    },
    "unit/cli/test_cli_build.py": {
        "a_binding_to_python_that_a_package_drops_is_told": 1,
        "a_program_may_be_called_like_one_of_the_files": 1,
        "an_extern_plant_gets_a_function_too": 0,
        "the_built_command_refuses_nonsense": 3,
    },
    "unit/cli/test_cli_colours.py": {
        "verify_recheck_and_advise_say_the_same_in_colour": 0,
    },
    "unit/cli/test_cli_formats.py": {
        "verify_in_all_formats": 0,
    },
    "unit/cli/test_cli_hostile.py": {
        "instances_called_like_parts_of_the_state": 1,
    },
    "unit/cli/test_cli_keeps_files.py": {
        "a_log_or_report_replaces_an_older_one": 1,
        "build_keeps_what_a_person_wrote_or_changed": 0,
    },
    "unit/cli/test_cli_new.py": {
        "what_it_makes_is_laid_out_and_sound": 0,
    },
    "unit/cli/test_cli_proved.py": {
        "what_is_not_decided_is_told": 0,
    },
    "unit/cli/test_cli_real_time.py": {
        "a_policy_that_fails_takes_nothing_with_it": 1,
        "people_are_told_of_leases": 0,
    },
    "unit/cli/test_cli_refused.py": {
        "what_cannot_be_written_is_named": 1,
    },
    "unit/cli/test_cli_run.py": {
        "python_and_c_do_the_same_on_both_engines": 2,
    },
    "unit/cli/test_cli_test.py": {
        "whatever_signal_ends_it_what_was_covered_is_printed": 1,
    },
    "unit/cli/test_cli_verify.py": {
        "a_refutation_comes_with_its_run": 0,
        "an_invariant_that_fails_inside_a_proof_is_exit_70": 0,
    },
    "unit/explore/test_checkpoints.py": {
        "ended_from_outside_it_goes_on": 1,
    },
    "unit/explore/test_covered_time.py": {
        "everything_before_the_covered_time_was_reached": 2,
    },
    "unit/explore/test_empty_tests.py": {
        "a_quarter_of_a_millisecond_finds_no_more": 1,
        "an_input_that_keeps_its_default_is_a_bound": 1,
        "such_programs_are_violated_and_clean": 0,
        "the_grid_of_the_calendar_alone_would_miss_it": 3,
        "times_that_a_program_tells_apart_are_tried": 2,
        "what_calculates_with_times_is_never_clean_on_a_grid_of_ours": 1,
        "where_nothing_was_judged_nothing_is_clean": 3,
    },
    "unit/explore/test_engine.py": {
        "exhaustive_strategies_end_and_samples_never_say_so": 0,
        "remembered_steps_and_steps_that_are_run_reach_the_same_worlds": 1,
    },
    "unit/explore/test_equal_instances.py": {
        "each_check_is_needed": 1,
        "instances_that_nothing_tells_apart_are_equal": 3,
        "instances_that_something_tells_apart_are_not": 5,
        "what_is_said_of_them_is_what_the_enumerator_says": 1,
    },
    "unit/explore/test_every_violated_property.py": {
        "random_programs_violate_what_the_enumerator_says": 0,
    },
    "unit/explore/test_explore_command.py": {
        "every_violation_is_replayed_and_has_a_step_of_its_own": 3,
    },
    "unit/explore/test_falsify.py": {
        "a_deadline_that_was_missed_is_below_zero_and_one_that_was_kept_above": 10,
        "it_finds_what_chance_does_not_find_in_as_many_executions": 1,
        "the_least_robustness_is_negative_iff_the_property_was_violated": 3,
    },
    "unit/explore/test_for_ever.py": {
        "a_deadline_that_the_horizon_hides_is_no_end": 0,
        "a_horizon_three_times_as_far_shows_nothing_new": 0,
        "a_slow_counter_is_not_taken_for_a_round": 1,
    },
    "unit/explore/test_joined.py": {
        "a_combination_is_violated_iff_it_is_reached_at_one_time": 3,
        "where_more_is_shared_all_of_it_is_explored": 1,
    },
    "unit/explore/test_messages_of_a_step.py": {
        "every_message_counts": 1,
    },
    "unit/explore/test_modules_above_modules.py": {
        "explorer_and_enumerator_agree_on_a_tower": 1,
    },
    "unit/explore/test_remembered_times.py": {
        "steps_remembered_with_their_times_reach_the_worlds_of_steps_that_are_run": 2,
    },
    "unit/explore/test_replaced_by_contract.py": {
        "all_that_the_contract_permits_is_published_and_nothing_else": 1,
    },
    "unit/explore/test_replay.py": {
        "every_execution_is_allowed_and_ends_as_the_enumerator_says": 6,
    },
    "unit/explore/test_robustness_margins.py": {
        "a_margin_is_positive_where_the_interpreter_says_true": 1,
    },
    "unit/explore/test_said_too_much.py": {
        "a_violation_whose_links_do_not_fit_has_a_trace": 1,
    },
    "unit/explore/test_shrinking.py": {
        "a_long_trace_over_floats_is_shrunk_where_minimising_ends_in_vain": 0,
        "shrinking_gives_the_same_trace_twice": 0,
        "shrunk_traces_of_random_programs_replay_and_violate_the_same": 1,
    },
    "unit/explore/test_slice.py": {
        "what_does_not_matter_may_choose_otherwise": 0,
    },
    "unit/explore/test_wide_steps.py": {
        "a_configuration_wider_than_there_is_room_for_says_so": 2,
        "a_step_that_never_ends_can_be_interrupted": 3,
        "as_many_choices_as_there_is_room_for_are_no_limit": 0,
        "memory_bounds_what_the_process_takes": 0,
        "more_choices_than_there_is_room_for_name_the_step": 1,
    },
    "unit/gym/test_protected.py": {
        "linked_c_with_a_memory_steps_once_a_step": 0,
        "many_environments_are_compiled_once_until_linked_c_changes": 0,
        "numbers_go_to_c_as_they_go_through_python": 0,
    },
    "unit/lsp/test_command.py": {
        "a_program_may_end_anywhere": 0,
    },
    "unit/lsp/test_names.py": {
        "a_program_with_another_name_is_the_same_program": 2,
    },
    "unit/lsp/test_resolve.py": {
        "every_read_leads_to_what_the_checker_reads": 4,
    },
    "unit/native/test_native_cache.py": {
        "a_damaged_library_is_made_anew": 1,
    },
    "unit/prelude/test_coefficients.py": {
        "constants_are_the_derived_ones": 0,
    },
    "unit/prelude/test_math_bounds.py": {
        "error_stays_within_bound": 6,
    },
    "unit/prelude/test_no_faults.py": {
        "any_arguments": 12,
    },
    "unit/program/test_check_cascades.py": {
        "a_misspelt_name_is_one_mistake": 11,
    },
    "unit/program/test_check_large.py": {
        "many_misspelt_names_are_not_all_compared": 1,
    },
    "unit/program/test_check_mutants.py": {
        "the_programs_themselves_are_sound": 3,
    },
    "unit/program/test_derived.py": {
        "only_one_file_takes_a_system_apart": 0,
    },
    "unit/program/test_evaluate.py": {
        "calls_deeper_than_the_stack_exceed_any_budget": 0,
    },
    "unit/program/test_fairness.py": {
        "every_alternative_comes_in_any_2n_executions": 0,
    },
    "unit/program/test_tables.py": {
        "a_table_is_read_as_the_same_bits_by_both_engines": 1,
        "many_numbers_come_from_any_file": 1,
    },
    "unit/reach/test_braking.py": {
        "a_brake_of_uncertain_strength_is_a_law_that_is_proved_and_rechecked": 0,
        "what_takes_room_away_is_no_law": 1,
    },
    "unit/reach/test_closed_loop_adversary.py": {
        "a_hole_put_back_is_found": 1,
        "where_nothing_is_late_it_moves_as_soter_run": 1,
    },
    "unit/reach/test_composition.py": {
        "a_guarantee_that_is_not_proved_leaves_the_conjunction_open": 0,
        "a_weaker_guarantee_proves_less": 0,
        "modules_may_lean_on_each_other": 0,
        "prover_and_rechecker_name_the_same_influences_by_themselves": 0,
        "the_convoy_is_proved_and_rechecked": 0,
        "the_terminal_shows_who_keeps_what": 0,
    },
    "unit/reach/test_coordinated.py": {
        "a_prover_that_thinks_it_knows_the_mode_is_found_out": 1,
        "a_step_on_defaults_is_tried_in_every_mode": 0,
        "an_adversary_who_chooses_the_mode_never_leaves_what_was_proved": 0,
        "half_spaces_know_predicates_with_modes_and_no_law_with_one": 1,
        "looking_at_a_mode_is_proved_and_rechecked": 1,
        "one_who_must_come_along_comes_too_late_or_not_and_is_never_counted_on": 1,
        "two_laws_that_keep_safe_do_not_when_they_take_turns": 0,
        "waiting_for_one_that_waits_gives_no_control_back": 1,
        "what_is_taken_for_granted_stands_in_the_table": 0,
        "what_needs_to_know_the_mode_is_not_proved": 1,
    },
    "unit/reach/test_coordinated_induction.py": {
        "a_prover_that_thinks_it_knows_the_mode_is_found_out": 1,
        "looking_at_a_mode_is_proved_and_rechecked": 1,
        "waiting_for_one_that_waits_gives_no_control_back": 0,
        "what_needs_to_know_the_mode_is_not_proved": 1,
    },
    "unit/reach/test_entered.py": {
        "a_guard_that_lets_too_much_in_is_not": 1,
        "it_does_not_hang_on_control_coming_back": 0,
        "it_is_shown_and_assumed_no_more": 0,
        "what_is_let_in_lies_in_the_set_wherever_that_is_shown": 1,
    },
    "unit/reach/test_failsafe_law.py": {
        "a_body_that_only_brakes_by_thrust_has_no_law": 1,
        "sc_has_to_keep_what_the_law_keeps": 0,
        "what_does_not_stand_still_is_not_proved": 1,
    },
    "unit/reach/test_failsafe_limits.py": {
        "a_law_that_only_the_prover_would_claim_is_rejected": 1,
        "what_would_help_is_said_of_each_law_that_is_not_shown": 0,
    },
    "unit/reach/test_handover.py": {
        "where_no_node_keeps_it_nothing_is_proved": 0,
        "who_asks_stays_inside_whatever_ac_does": 3,
        "without_enters_every_change_is_an_assumption": 0,
    },
    "unit/reach/test_heard_beside.py": {
        "the_plant_of_the_proof_is_followed_through_whoever_hears_it": 0,
        "what_is_heard_beside_is_told_and_adds_no_age": 1,
    },
    "unit/reach/test_induction.py": {
        "a_fail_safe_value_that_is_safe_does_no_harm": 0,
        "a_plan_that_is_published_again_and_again_never_settles": 0,
        "a_response_delays_what_is_published": 0,
        "a_wrong_planner_is_never_proved": 1,
        "declared_times_make_p1c_proved_and_need_a_longer_threshold": 0,
        "floats_are_equal_as_floats_are_and_not_as_terms": 0,
        "functions_have_names_of_their_own": 0,
        "lists_of_other_things_are_other_lists": 0,
        "progress_is_assumed_and_printed": 0,
        "what_a_node_takes_counts_as_its_response": 1,
        "what_an_induction_rests_on_is_said_and_nothing_of_sets": 0,
        "what_else_the_language_has_is_followed_or_left_open": 0,
        "what_is_opaque_is_named_and_no_assumption": 0,
        "what_is_opaque_proves_nothing_wrong": 1,
        "without_progress_nothing_says_that_ac_gets_control_back": 1,
    },
    "unit/reach/test_induction_heard.py": {
        "a_lemma_about_it_has_it_followed": 0,
    },
    "unit/reach/test_instances_proved.py": {
        "a_module_is_proved_with_its_own_parameters_and_the_topics_around_it": 1,
        "every_element_is_a_problem_of_its_own_and_so_says_its_certificate": 0,
    },
    "unit/reach/test_inward_groups.py": {
        "one_cell_is_kept_exactly_if_the_flow_points_inwards_at_its_ends": 1,
    },
    "unit/reach/test_mutants.py": {
        "a_mutant_is_refuted": 1,
    },
    "unit/reach/test_programs_once_proved.py": {
        "an_sc_that_faults_on_the_default_is_not_proved": 0,
    },
    "unit/reach/test_recover_time.py": {
        "the_rechecker_holds_t_to_the_same_terms": 0,
    },
    "unit/reach/test_refute.py": {
        "a_bad_module_is_refuted": 3,
        "a_sound_module_is_not": 1,
    },
    "unit/reach/test_starts.py": {
        "a_parameter_that_moves_the_start_counts": 0,
        "both_starts_have_to_be_among_those_proved": 1,
        "of_a_start_that_is_drawn_nothing_is_said": 0,
    },
    "unit/reach/test_verify.py": {
        "what_is_wrong_is_not_proved": 1,
    },
    "unit/reach/test_verify_groups.py": {
        "a_finer_grid_settles_borders_and_forgets_no_failure": 0,
        "a_map_is_proved_in_steps_and_a_wrong_one_is_not": 0,
        "states_that_the_constraint_compares_must_be_one_group": 0,
    },
    "unit/reach/test_views.py": {
        "a_certificate_in_which_a_view_stands_twice_is_rejected": 0,
        "a_certificate_without_one_of_the_views_is_rejected": 1,
        "a_predicate_in_a_view_never_says_more_than_the_whole": 0,
        "an_open_end_lies_beyond_the_grid": 1,
        "what_one_view_cannot_show_is_not_proved": 1,
        "what_only_safe_reads_is_said_to_be_judged_on_the_plant_of_the_proof": 0,
    },
    "unit/reach/test_wrong_modules.py": {
        "a_wrong_module_is_not_proved_without_a_word": 1,
        "a_wrong_module_that_was_once_proved_is_not": 1,
        "the_right_modules_that_they_are_made_from_are_proved": 1,
    },
    "unit/reach_computed/test_advise.py": {
        "what_it_says_of_the_declared_period_is_what_verify_says": 0,
    },
    "unit/reach_computed/test_complete.py": {
        "sets_that_are_too_large_would_be_noticed": 0,
        "the_second_time_they_come_from_the_cache": 0,
    },
    "unit/reach_computed/test_deployed.py": {
        "half_spaces_of_all_values_are_what_polytopes_return_to": 0,
    },
    "unit/reach_computed/test_dm_check.py": {
        "a_changed_dm_is_refuted": 1,
        "one_wrong_entry_of_a_table_is_found": 0,
    },
    "unit/reach_computed/test_margin.py": {
        "levels_are_counted": 1,
        "nobody_takes_over_before_the_margin_said": 1,
    },
    "unit/reach_enclose/test_module_enclosures.py": {
        "what_a_module_does_lies_in_its_enclosures": 1,
    },
    "unit/reach_grids/test_grid_enclosures.py": {
        "a_nonlinear_flow_is_enclosed": 0,
        "runs_stay_in_images_and_tubes": 3,
    },
    "unit/reach_grids/test_grid_sets.py": {
        "no_run_escapes_the_core": 1,
        "runs_escape_a_core_that_forgets": 1,
    },
    "unit/reach_grids/test_honest_modules.py": {
        "a_module_just_beyond_is_not": 1,
        "an_honest_module_is_proved": 1,
    },
    "unit/reach_grids/test_other_groups.py": {
        "one_control_is_asked_alone_only_where_all_of_sc_is_free_of_faults": 1,
        "runs_of_any_group_stay_in_images_and_tubes": 1,
    },
    "unit/reach_grids/test_policies.py": {
        "the_way_back_takes_no_longer_than_claimed": 2,
    },
    "unit/reach_grids/test_standing_and_kept_ends.py": {
        "one_state_stands_beside_another_that_moves": 0,
    },
    "unit/reach_polytopes/test_polytope_adversary.py": {
        "a_hole_put_back_by_hand_is_found": 1,
        "an_sc_that_was_taken_to_be_in_time_is_found": 0,
        "nobody_leaves_k_by_timing": 1,
        "the_end_of_a_hold_is_where_it_was_said_to_be": 1,
    },
    "unit/reach_polytopes/test_polytopes.py": {
        "five_states_are_proved": 0,
        "sc_keeps_the_constraint_from_every_state_of_k": 1,
    },
    "unit/reach_polytopes/test_verify_polytopes.py": {
        "computed_predicates_are_proved_and_compiled": 0,
        "predicates_that_forget_the_errors_are_not_proved": 0,
        "runs_of_the_compiled_program_under_attack_find_nothing": 0,
        "what_is_wrong_is_undecided": 1,
    },
    "unit/reach_synthesis/test_synthesis.py": {
        "a_controller_between_two_walls_is_found_written_and_proved": 0,
        "outputs_with_several_leaves_get_a_constant_each": 0,
    },
    "unit/reach_undecided/test_coarse_cells.py": {
        "a_k_that_no_run_leaves_is_told_so": 0,
        "an_invariant_that_fails_in_an_experiment_is_a_defect": 0,
        "smaller_cells_give_the_k_that_is_promised": 0,
    },
    "unit/reach_undecided/test_margins.py": {
        "a_predicate_of_two_states_has_a_distance_along_one_axis": 0,
    },
    "unit/reach_undecided/test_start_margins.py": {
        "a_start_outside_the_grid_is_told_from_one_where_safe_is_false": 0,
    },
    "unit/reach_undecided/test_strength.py": {
        "sc_keeps_a_set_with_that_part_and_none_with_the_next": 0,
    },
    "unit/reach_undecided/test_vacuity.py": {
        "a_polytope_is_measured_too": 0,
    },
    "unit/reach_undecided/test_way_back.py": {
        "a_grid_that_would_not_help_is_not_advised": 0,
        "an_sc_that_only_stops_is_told_from_one_that_is_weak": 0,
        "cells_that_are_too_coarse_are_told_with_a_grid_that_does": 0,
    },
    "unit/recheck/test_authority.py": {
        "a_delay_that_is_longer_is_what_counts": 0,
        "a_time_that_is_shorter_than_there_is_is_rejected": 1,
        "assumptions_of_the_manifest_are_not_read": 0,
        "the_verdict_says_what_it_is_about": 0,
    },
    "unit/recheck/test_certificates.py": {
        "the_adversary_sees_what_is_wrong": 0,
        "what_the_prover_writes_is_accepted": 0,
    },
    "unit/recheck/test_deployed_tables.py": {
        "a_larger_set_with_a_table_that_fits_is_rejected": 1,
    },
    "unit/recheck/test_local_certificates.py": {
        "a_rank_too_low_is_rejected": 0,
        "nothing_false_is_accepted_of_what_was_changed": 0,
        "one_more_cell_is_rejected": 1,
    },
    "unit/recheck/test_local_chains.py": {
        "chains_enclose_runs": 9,
    },
    "unit/recheck/test_nodes_that_take_time.py": {
        "a_proof_counts_with_the_longest_and_its_certificate_is_accepted": 0,
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
    "unit/recheck/test_recheck_command.py": {
        "accepted_is_0": 0,
    },
    "unit/recheck/test_recheck_induction.py": {
        "a_manifest_made_wrong_is_rejected": 1,
        "a_program_made_wrong_is_rejected": 1,
        "more_than_is_proved_of_what_is_opaque_is_rejected": 0,
        "what_is_opaque_is_accepted_as_far_as_it_is_proved": 0,
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
    "unit/semantics/test_schemes.py": {
        "random_programs_are_integrated_by_every_scheme": 0,
    },
    "unit/simulate/test_simulate_rounding.py": {
        "linked_c_that_rounds_otherwise_ends_the_run": 1,
    },
    "unit/simulate/test_why.py": {
        "the_run_command_lists_why": 0,
    },
    "unit/syntax/test_syntax_grammar.py": {
        "grammar_accepts_what_it_generates": 0,
        "grammar_and_parser_agree_on_programs_with_one_token_changed": 0,
    },
    "unit/syntax/test_syntax_hostile.py": {
        "diagnostics_of_hostile_text_can_be_shown": 10,
        "hostile_text_is_answered_quickly": 7,
        "truncating_a_program_anywhere_is_answered": 0,
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
    "unit/test_docstrings.py": {
        "functions_of_arrays_say_their_shapes": 0,
    },
    "unit/test_long_tests.py": {
        "what_is_left_out_is_told": 1,
    },
}
"""File below tests/ -> the name of a test, without `test_` -> lines of its table."""
