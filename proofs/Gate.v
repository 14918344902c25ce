(* A gate that looks at commands: the DM's verdict is about the commands that may act, not about all of U.
   Purpose: "The gate" of proof-flight.md: who may act is V, refused commands are never published, silence is judged.
   Non-goals: how R_V(H) is computed; the nearest permitted command; memory behind the gate (shapers, rate limits). *)
Require Import Reals Lra Lia Classical.
From Soter Require Import Releases Trajectories ScRuns Module.
Open Scope R_scope.
Section Gate.
Variable P : plant. Variable T : times.
Variable answers : estimate P -> (component P -> value P) -> Prop.
Variable ex : @execution P T answers. Hypothesis TH : times_hold T.
(* V at a state of time s, of what was published until `now`: of each component the last value published at or before
   s - L, and all since. Components change at different instants: V is a product, a set for each of them. *)
Definition may_act s now i v := exists e a, emitted ex i e a v /\ e <= now /\
  forall e' a' v', emitted ex i e' a' v' -> e' <= s - L T -> e' <= e.

(* judgement s now: V was judged at `now`, about a state of time s. *)
Variable judgement : R -> R -> Prop.
Hypothesis judges_the_past : forall s now, judgement s now -> 0 <= s <= now.

(* Silence: at each of its steps the DM judges what may act. What is published between that judgement and the verdict is
   in V or judged by itself. *)
Hypothesis silence : forall k, says_ac ex k -> exists s now, judgement s now /\ dm_release T k - age T <= s /\
  dm_start ex k <= now <= dm_out ex k /\
  forall i e a v, emitted ex i e a v -> now < e <= dm_out ex k -> ac_mode ex e.
(* What AC publishes is judged, together with what may act beside it, on a state that is no older than what the last step
   of the DM may have read. *)
Hypothesis judged : forall i e a v, emitted ex i e a v -> 0 <= e -> ac_mode ex e ->
  exists s, judgement s e /\ forall k, dm_start ex k <= e -> dm_release T k - age T <= s.
Hypothesis finitely_many : forall t, (exists i e a v, emitted ex i e a v /\ e < t) ->
  exists i e a v, emitted ex i e a v /\ e < t /\ forall i' e' a' v', emitted ex i' e' a' v' -> e' < t -> e' <= e.

(* After verdict j, of what was published before b the last judgement counts, if all of it since was judged. *)
Lemma last_judgement : forall j b, says_ac ex j -> dm_out ex j <= b ->
  (forall i e a v, emitted ex i e a v -> dm_out ex j < e < b -> ac_mode ex e) ->
  exists s now, judgement s now /\ dm_release T j - age T <= s <= b /\
    (now <= dm_out ex j \/ now < b /\ ac_mode ex now) /\ forall i e a v, emitted ex i e a v -> e < b -> e <= now.
Proof. intros j b Ac Hb Since. destruct (silence j Ac) as (s & now & Gs & S1 & S2 & S3).
  destruct (dm_window P T answers ex TH j) as (D1 & D2 & _ & _ & D5).
  destruct (classic (exists i e a v, emitted ex i e a v /\ now < e < b)) as [(i & e & a & v & E & Eb) | No].
  - destruct (finitely_many b) as (i' & e' & a' & v' & E' & Eb' & Last); [exists i, e, a, v; split; auto; lra |].
    pose proof (Last _ _ _ _ E ltac:(lra)). assert (Ac' : ac_mode ex e').
    { destruct (Rle_or_lt e' (dm_out ex j)); [apply (S3 _ _ _ _ E') | apply (Since _ _ _ _ E')]; lra. }
    destruct (judged _ _ _ _ E' ltac:(lra) Ac') as (s' & G' & R').
    exists s', e'. split; [exact G' |]. pose proof (R' j ltac:(lra)). destruct (judges_the_past _ _ G').
    split; [lra | split; [auto | exact Last]].
  - exists s, now. split; [exact Gs |]. destruct (judges_the_past _ _ Gs). split; [lra | split; [lra |]]. intros i e a v E Eb.
    destruct (Rle_or_lt e now); auto. exfalso. apply No. exists i, e, a, v. repeat split; auto.
Qed.

(* Until what was published at b or later acts, V acts. *)
Lemma V_acts : forall s now b t1, 0 <= s -> (forall i e a v, emitted ex i e a v -> e < b -> e <= now) ->
  (forall i e a v, emitted ex i e a v -> b <= e -> a < t1 -> False) -> within P (may_act s now) (u ex) s t1.
Proof. intros s now b t1 S0 Em Late t i Ht. destruct (acting ex t i ltac:(lra)) as (e & a & E & Ha & Last).
  exists e, a. split; [exact E |]. split.
  - apply (Em _ _ _ _ E). destruct (Rlt_or_le e b) as [| Q]; auto. exfalso. apply (Late _ _ _ _ E Q). lra.
  - intros e' a' v' E' He'. apply (Last _ _ _ E'). destruct (emitted_in_U ex _ _ _ _ E'). lra.
Qed.

(* Of what passes after verdict j + 1 mx is the first; m1 waited for that verdict. *)
Lemma first_to_pass : forall j n, (forall k, (j < k < n)%nat -> ~ says_ac ex k) -> exists mx m1, (mx <= m1)%nat /\
  dm_out ex (S j) <= sc_out ex mx /\ dm_out ex (S j) <= sc_start ex m1 /\ dm_release T (S j) <= sc_release T m1 /\
  complete ex m1 <= dm_release T j - age T + H_star T /\
  (forall t, dm_out ex (S j) <= t < dm_out ex n -> ~ ac_mode ex t) /\
  forall i e a v, emitted ex i e a v -> dm_out ex (S j) <= e < dm_out ex n ->
    sc_out ex mx <= e /\ sc_out ex mx + L_min T <= a.
Proof. intros j n NoAc. destruct (takes_over_in_time P T answers ex TH j) as (m1 & M1 & M2 & M3).
  assert (Mx : dm_out ex (S j) <= sc_out ex m1) by (destruct (sc_publishes ex m1); lra).
  destruct (least (fun m => dm_out ex (S j) <= sc_out ex m) m1 Mx) as (mx & Mx1 & Mx2).
  destruct (dm_window P T answers ex TH (S j)) as (F1 & F2 & _ & _ & F5).
  assert (No : forall t, dm_out ex (S j) <= t < dm_out ex n -> ~ ac_mode ex t).
  { intros t Ht. apply (no_ac P T answers ex TH (S j) n); [intros k Kn; apply NoAc; lia | right |]; lra. }
  exists mx, m1. split; [apply Mx2; exact Mx |]. do 5 (split; [assumption |]). intros i e a v E He.
  destruct (sc_alone ex _ _ _ _ E) as (m & -> & -> & _); [lra | apply No; exact He |].
  pose proof (sc_out_order P T answers ex TH _ _ (Mx2 m (proj1 He))). pose proof (sc_acts ex m i). lra.
Qed.

Lemma ac_mode_until : forall j, says_ac ex j -> forall e, dm_out ex j <= e < dm_out ex (S j) -> ac_mode ex e.
Proof. intros j Acj e He. exists j. repeat split; auto; [lra |]. intros k' Hk'.
  destruct (Nat.le_gt_cases k' j) as [| Gt]; auto. apply (dm_out_order P T answers ex TH) in Gt. lra.
Qed.

Variable m0 : nat. Variable q : R.
Hypothesis counts_from : forall m, (m0 <= m)%nat -> counts ex m.
Hypothesis q_last : forall k, dm_release T k <= sc_release T m0 -> dm_release T k <= q.
Variables C K : state P -> Prop.
Hypothesis K_in_C : forall z, K z -> C z.
Hypothesis P2a : core P answers (delta T) (window T) (state_age T) C K.
Hypothesis start : look_ahead P K (h_0 T (sc_release T m0) q) (x ex 0).
Variable H : R.
Hypothesis P1c : H_star T <= H.

(* What V is judged to be: x^ - E in R_V(H). *)
Definition good s now := 0 <= s <= now /\ exists y, reads_as P (x ex s) y /\
  forall z, reads_as P z y -> gated_look_ahead P K (may_act s now) H (L T - L_min T) z.

Hypothesis found_good : forall s now, judgement s now -> good s now.
(* SC's outputs that pass after a good verdict count. *)
Hypothesis available : forall k m, says_ac ex k -> dm_out ex k <= sc_out ex m -> counts ex m.

(* K until t, if what was published at b or later acts at t1 or later, SC is complete L - L_min after that. *)
Lemma gate_keeps : forall j b t1 t, says_ac ex j -> dm_out ex j <= b ->
  (forall i e a v, emitted ex i e a v -> dm_out ex j < e < b -> ac_mode ex e) ->
  b <= t1 <= t -> (forall i e a v, emitted ex i e a v -> b <= e -> a < t1 -> False) ->
  t <= t1 + (L T - L_min T) -> t <= dm_release T j - age T + H -> 0 <= b -> K (x ex t).
Proof. intros j b t1 t Ac Hb Since T1 Late Tw TH' B0.
  destruct (last_judgement j b Ac Hb Since) as (s & now & G & Sb & _ & Em).
  destruct (found_good s now G) as [[S0 Sn] (y & Ry & Ok)].
  apply (gated_along P K (may_act s now) H (L T - L_min T) (x ex) (u ex) s t1 t); auto; try lra.
  - apply V_acts with b; auto.
  - apply U_only. lra.
  - apply moves_from. lra.
Qed.

Lemma gate_until : forall n t, 0 <= t <= dm_out ex n -> C (x ex t).
Proof. induction n as [n IH] using (well_founded_induction lt_wf). intros t Ht.
  destruct (classic (exists k, (k < n)%nat /\ says_ac ex k)) as [Some | None].
  2: { apply (invariant_C P T answers ex C K K_in_C P2a); [lra |].
       apply (invariant_at_first P T answers ex TH m0 q) with n; auto. intros k Kn Ak. apply None. eauto. }
  destruct (last_below (says_ac ex) n Some) as (j & Jn & Acj & NoAc).
  destruct (dm_window P T answers ex TH j) as (D1 & D2 & D3 & D4 & D5).
  destruct (dm_window P T answers ex TH (S j)) as (F1 & F2 & F3 & _). pose proof (not_negative T TH) as NN.
  assert (Rel : dm_release T (S j) = dm_release T j + Delta T) by (unfold dm_release; rewrite S_INR; ring).
  destruct (Rle_or_lt t (dm_out ex j)) as [Q | Q]; [apply (IH j); auto; lra |].
  assert (Acm := ac_mode_until j Acj).
  (* mx is SC's first output that passes from the verdict of j + 1 on, if that is not "AC" *)
  destruct (first_to_pass j n NoAc) as (mx & m1 & Mle & Mx1 & _ & _ & M3 & No & ScOnly).
  pose proof (sc_window P T answers ex TH mx) as Acts.
  assert (In_time : complete ex mx <= dm_release T j - age T + H).
  { destruct (Nat.eq_dec mx m1) as [-> | Ne]; [lra |]. destruct (sc_complete ex m1) as [Cm _].
    destruct (sc_complete ex mx) as [_ [i <-]]. destruct (sc_in_order P T answers ex TH mx m1 i); [lia |].
    specialize (Cm i). lra. }
  assert (KeepK : forall t', dm_out ex j <= t' <= dm_out ex n -> t' <= complete ex mx -> K (x ex t')).
  { intros t' Ht' Hc. set (b := Rmin t' (sc_out ex mx)). set (t1 := Rmin t' (sc_out ex mx + L_min T)).
    assert (B : b <= t' /\ b <= sc_out ex mx /\ (t' <= b \/ sc_out ex mx <= b))
      by (unfold b, Rmin; destruct Rle_dec; lra).
    assert (B' : t1 <= t' /\ t1 <= sc_out ex mx + L_min T /\ b <= t1 /\ t' <= t1 + (L T - L_min T))
      by (unfold b, t1, Rmin; repeat destruct Rle_dec; lra). clearbody b t1. destruct B as (B1 & B2 & B3).
    apply gate_keeps with j b t1; auto; try (destruct B3; lra); intros i e a v E He; [| intros Ha];
      destruct (emitted_in_U ex _ _ _ _ E) as [Ea _]; (destruct (Rlt_or_le e (dm_out ex (S j))) as [Q' | Q'];
      [| destruct B3; destruct (ScOnly _ _ _ _ E); lra]); [apply Acm; lra | destruct B3; lra]. }
  destruct (Rle_or_lt t (complete ex mx)) as [Q2 | Q2]; [apply K_in_C, KeepK; lra |].
  apply (invariant_C P T answers ex C K K_in_C P2a); [lra |]. right. exists mx. split; [apply KeepK; lra |].
  split; [lra |]. apply sc_run_begins; auto; [| lra | |].
  - intros n' N' _. apply (available j); auto. pose proof (sc_out_order P T answers ex TH _ _ N'). lra.
  - intros t' Ht'. destruct (Rle_or_lt t' (dm_out ex j)); [apply (IH j); auto | apply K_in_C, KeepK]; lra.
  - intros t' Ht'. apply (no_ac P T answers ex TH (S j) n); [intros k Kn; apply NoAc; lia | right |]; lra.
Qed.

Theorem gate_safe : forall t, 0 <= t -> C (x ex t).
Proof. intros t T0. destruct (verdicts_go_on P T answers ex TH t) as [n Hn]. apply (gate_until n). lra. Qed.
End Gate.
