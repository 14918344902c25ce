(* Control comes back.
   Purpose: "P2b" of proof-sets.md: with fresh reads a verdict "AC" is in force in bounded time after SC took over.
   Non-goals: modes of other modules in `safer`, several groups; how Q and the chains to it are found. *)
Require Import Reals Lra Lia Classical.
From Soter Require Import Releases Trajectories ScRuns Module.
Open Scope R_scope.
Theorem control_returns : forall P T answers (ex : @execution P T answers) (C K Q : state P -> Prop)
    (safer : estimate P -> Prop) T_Q m,
  times_hold T ->
  core P answers (delta T) (window T) (state_age T) C K ->
  keeps P answers (delta T) (window T) (state_age T) C Q (fun z => forall y, reads_as P z y -> safer y) ->
  (* output m of SC and all after it count and pass; where it is complete the state is in K *)
  (forall n, (m <= n)%nat -> counts ex n) -> ~ ac_mode ex (sc_out ex m) ->
  (forall t, 0 <= t <= complete ex m -> C (x ex t)) -> K (x ex (complete ex m)) ->
  leads_to P answers (delta T) (window T) (state_age T) C Q T_Q (x ex (complete ex m)) ->
  (* reads are fresh, no gate fault is latched: the DM goes by `safer` *)
  (forall k, complete ex m <= dm_start ex k -> exists s y, dm_start ex k - age T <= s <= dm_start ex k /\
    reads_as P (x ex s) y /\ (safer y -> says_ac ex k)) ->
  exists k, says_ac ex k /\
    sc_out ex m <= dm_out ex k <= complete ex m + T_Q + window T + age T + Delta T + dm_late T + dm_response T.
Proof. intros P T answers ex C K Q safer T_Q m TH HK HQ Hc Hm HC Km Lead Fresh. apply NNPP. intros No.
  pose proof (sc_window P T answers ex TH m) as W.
  pose proof (not_negative T TH) as NN. pose proof (periods T TH). pose proof (window_pos T TH).
  assert (0 <= T_Q) by (inversion Lead as [| t' z' N]; subst; auto; pose proof (pos_INR N); nra).
  set (tau := complete ex m + T_Q + window T) in *. set (b := tau + age T + Delta T + dm_late T + dm_response T) in *.
  assert (Sc : forall t, sc_out ex m <= t < b -> ~ ac_mode ex t).
  { intros t Ht (k & Hk & Ac & Last). destruct (Rle_or_lt (sc_out ex m) (dm_out ex k)).
    - apply No. exists k. split; auto. unfold b, tau in *. lra.
    - apply Hm. exists k. repeat split; auto; [lra |]. intros k' Hk'. apply Last. lra. }
  assert (Run := sc_run_begins P T answers ex TH C m b (fun n Hn _ => Hc n Hn) ltac:(unfold b, tau; lra) HC Sc).
  destruct (next_release (dm_phase T) (Delta T) (tau + age T)) as [k Hk]; [lra | unfold tau; lra |].
  change (dm_phase T + INR k * Delta T) with (dm_release T k) in Hk.
  destruct (dm_window P T answers ex TH k) as (D1 & D2 & D3 & _).
  destruct (Fresh k) as (s & y & S1 & S2 & S3); [unfold tau in Hk; lra |].
  assert (Safe : forall y, reads_as P (x ex s) y -> safer y).
  { apply (run_arrives P answers (delta T) (window T) (state_age T) C ltac:(lra) ltac:(lra) K Q
      (fun z => forall y, reads_as P z y -> safer y) HK HQ T_Q _ Lead _ _ _ _ _ _ _ Run);
      rewrite ?Nat.add_0_r; auto. unfold b, tau in *. lra. }
  apply No. exists k. split; [auto |]. unfold b, tau in *. lra.
Qed.
