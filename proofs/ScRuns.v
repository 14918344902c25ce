(* Runs under SC, cores, and how chains show a core and a return.
   Purpose: "SC-run" and "Core" of docs/proof.md, "Chains" and the sets of "P2b" of proof-sets.md, rests on the way in proof-flight.md.
   Non-goals: how K, Q and W are computed. *)
Require Import Reals Lra Lia Classical.
From Soter Require Import Releases Trajectories.
Open Scope R_scope.
Section Runs.
Variable P : plant.
Variable answers : estimate P -> (component P -> value P) -> Prop.  (* what SC may answer, whatever its locals in La *)
Variables delta j d : R.                                           (* period, window of an output, age of its state *)
Variable C : state P -> Prop.
Hypothesis j_pos : 0 <= j. Hypothesis j_small : j < delta.

(* An SC-run, looked at until b: output k acts on component i at act k i, on all of them from all_act k on. *)
Record sc_run (x : R -> state P) (u : R -> component P -> value P) (act : nat -> component P -> R)
    (all_act : nat -> R) (out : nat -> component P -> value P) (t0 b : R) : Prop := {
  run_windows : forall k i, t0 + INR k * delta <= act k i <= t0 + INR k * delta + j;
  run_last : forall k, (forall i, act k i <= all_act k) /\ exists i, act k i = all_act k;
  run_begins : 0 <= all_act 0%nat <= b;
  run_before : forall t, 0 <= t -> all_act 0%nat - d <= t <= all_act 0%nat -> C (x t);
  run_inputs : within P (inputs P) u 0 b;
  run_commands : forall k i t, act k i <= t < act (S k) i -> 0 <= t < b -> u t i = out k i;
  run_reads : forall k, (exists i, act k i < b) -> exists y, answers y (out k) /\ forall p, exists s,
    0 <= s /\ all_act k - d <= s /\ (forall i, s <= act k i) /\ shows P p (x s) y;
  run_flow : flow P x u 0 b }.

(* On every SC-run from K the state is in S from a_0 on. A core keeps the constraint. *)
Definition keeps (K S : state P -> Prop) := forall x u act all_act out t0 b,
  sc_run x u act all_act out t0 b -> K (x (all_act 0%nat)) -> forall t, all_act 0%nat <= t <= b -> S (x t).
Definition core (K : state P -> Prop) := keeps K C.
Lemma last_window : forall x u act al out t0 b k, sc_run x u act al out t0 b ->
  t0 + INR k * delta <= al k <= t0 + INR k * delta + j.
Proof. intros. destruct (run_last _ _ _ _ _ _ _ H k) as [_ [i E]]. rewrite <- E. apply (run_windows _ _ _ _ _ _ _ H). Qed.

(* A suffix of an SC-run is an SC-run, if the state was in C until then. *)
Lemma run_suffix : forall x u act al out t0 b N, sc_run x u act al out t0 b -> al N <= b ->
  (forall t, al 0%nat <= t <= al N -> C (x t)) ->
  sc_run x u (fun k => act (N + k)%nat) (fun k => al (N + k)%nat) (fun k => out (N + k)%nat) (t0 + INR N * delta) b.
Proof. intros x u act al out t0 b N H Hb HC. pose proof (last_window _ _ _ _ _ _ _ 0%nat H) as W0.
  pose proof (last_window _ _ _ _ _ _ _ N H) as WN. destruct H as [W M B Bf U Cm Rd F]. simpl in W0.
  constructor; auto.
  - intros k i. specialize (W (N + k)%nat i). rewrite plus_INR in W. lra.
  - rewrite Nat.add_0_r. split; auto. destruct N; [lra |]. rewrite S_INR in WN. pose proof (pos_INR N). nra.
  - rewrite Nat.add_0_r. intros t T0 Ht. destruct (Rle_or_lt t (al 0%nat)) as [Q | Q]; [| apply HC; lra].
    apply Bf; auto. destruct N; [lra |]. rewrite S_INR in WN. pose proof (pos_INR N). nra.
  - intros k i t Ht Hb'. apply Cm; auto. replace (S (N + k)) with (N + S k)%nat by lia. exact Ht.
Qed.

(* Every run from K leads back to K, in S all the way, after some number N >= 1 of outputs, which is the run's own. *)
Definition returns (K S : state P -> Prop) := forall x u act al out t0 b, sc_run x u act al out t0 b -> K (x (al 0%nat)) ->
  exists N, (1 <= N)%nat /\ (forall t, al 0%nat <= t <= Rmin b (al N) -> S (x t)) /\ (al N <= b -> K (x (al N))).

Theorem keeps_of_returns : forall (K S : state P -> Prop), (forall z, S z -> C z) -> returns K S -> keeps K S.
Proof.
  intros K S SC HK. assert (Q : forall n x u act al out t0 b, sc_run x u act al out t0 b -> K (x (al 0%nat)) ->
    forall t, al 0%nat <= t <= b -> t <= al 0%nat + INR n * (delta - j) -> S (x t)).
  { induction n; intros x u act al out t0 b H K0 t Ht Hn; destruct (HK _ _ _ _ _ _ _ H K0) as (N & N1 & CC & KN);
      pose proof (last_window _ _ _ _ _ _ _ 0%nat H) as W0; pose proof (last_window _ _ _ _ _ _ _ N H) as WN;
      assert (1 <= INR N) by (apply (le_INR 1); exact N1); simpl in W0.
    - apply CC. simpl in Hn. unfold Rmin. destruct (Rle_dec b (al N)); nra.
    - destruct (Rle_or_lt t (al N)) as [L | G].
      + apply CC. unfold Rmin. destruct (Rle_dec b (al N)); lra.
      + assert (S' := run_suffix _ _ _ _ _ _ _ N H). apply (IHn _ _ _ _ _ _ _ (S' ltac:(lra)
          ltac:(intros q Hq; apply SC, CC; unfold Rmin; destruct (Rle_dec b (al N)); lra)));
          rewrite ?Nat.add_0_r; [apply KN; lra | lra |]. rewrite S_INR in Hn. nra. }
  intros x u act al out t0 b H K0 t Ht. destruct (enough_steps (t - al 0%nat) (delta - j)) as [n Hn]; [lra |].
  apply (Q n _ _ _ _ _ _ _ H K0 t Ht). lra.
Qed.

(* Chains: N may be another one for each state of K, and is the same for all runs from there. *)
Definition chained (K S : state P -> Prop) := forall z, K z -> exists N, (1 <= N)%nat /\
  forall x u act al out t0 b, sc_run x u act al out t0 b -> x (al 0%nat) = z ->
    (forall t, al 0%nat <= t <= Rmin b (al N) -> S (x t)) /\ (al N <= b -> K (x (al N))).
Corollary keeps_of_chains : forall (K S : state P -> Prop), (forall z, S z -> C z) -> chained K S -> keeps K S.
Proof. intros K S SC HK. apply keeps_of_returns; auto. intros x u act al out t0 b H K0. destruct (HK _ K0) as (N & N1 & Ch).
  exists N. destruct (Ch _ _ _ _ _ _ _ H eq_refl). auto.
Qed.

(* A set B on the way: every run from K is in B at one of its outputs, and every run from B leads on to K. *)
Theorem returns_collected : forall K B S : state P -> Prop, (forall z, S z -> C z) ->
  (forall x u act al out t0 b, sc_run x u act al out t0 b -> K (x (al 0%nat)) -> exists N,
    (forall t, al 0%nat <= t <= Rmin b (al N) -> S (x t)) /\ (al N <= b -> B (x (al N)))) ->
  (forall x u act al out t0 b, sc_run x u act al out t0 b -> B (x (al 0%nat)) -> exists N, (1 <= N)%nat /\
    (forall t, al 0%nat <= t <= Rmin b (al N) -> S (x t)) /\ (al N <= b -> K (x (al N)))) -> returns K S.
Proof. intros K B S SC First Second x u act al out t0 b H K0. destruct (First _ _ _ _ _ _ _ H K0) as (N & In & At).
  pose proof (last_window _ _ _ _ _ _ _ N H) as W. pose proof (last_window _ _ _ _ _ _ _ (Datatypes.S N) H) as W'.
  rewrite S_INR in W'. destruct (Rle_or_lt (al N) b) as [L | G].
  - assert (R := run_suffix _ _ _ _ _ _ _ N H L
      ltac:(intros q Hq; apply SC, In; unfold Rmin; destruct (Rle_dec b (al N)); lra)).
    destruct (Second _ _ _ _ _ _ _ R) as (N' & N1 & In' & At'); [rewrite Nat.add_0_r; auto |].
    rewrite Nat.add_0_r in In'. exists (N + N')%nat. split; [lia |]. split; auto.
    intros t Ht. destruct (Rle_or_lt t (al N)); [apply In | apply In'; lra].
    unfold Rmin. destruct (Rle_dec b (al N)); lra.
  - exists (Datatypes.S N). split; [lia |]. split; [| intros; lra].
    intros t Ht. apply In. unfold Rmin in *. destruct (Rle_dec b (al N)); destruct (Rle_dec b (al (Datatypes.S N))); lra.
Qed.

Corollary core_of_chains : forall K, chained K C -> core K.
Proof. intros K. apply keeps_of_chains. auto. Qed.

(* Return: from z every SC-run is in Q at some all_act k, at most T + j after its beginning; T sums the chains. *)
Inductive leads_to (Q : state P -> Prop) : R -> state P -> Prop :=
  | arrived : forall T z, 0 <= T -> Q z -> leads_to Q T z
  | chain_to : forall T z N, 0 <= T -> (forall x u act al out t0 b, sc_run x u act al out t0 b -> x (al 0%nat) = z ->
      al N <= b -> leads_to Q T (x (al N))) -> leads_to Q (T + INR N * delta) z.


Theorem run_arrives : forall K Q S, core K -> keeps Q S -> forall T z, leads_to Q T z ->
  forall x u act al out t0 b, sc_run x u act al out t0 b -> x (al 0%nat) = z -> K z ->
  forall t, t0 + T + j <= t <= b -> S (x t).
Proof.
  intros K Q S HK HQ T z HT. assert (G : forall x u act al out t0 b, sc_run x u act al out t0 b -> x (al 0%nat) = z ->
    (forall t, al 0%nat <= t <= b -> C (x t)) -> forall t, t0 + T + j <= t <= b -> S (x t)).
  { induction HT as [T z T0 Qz | T z N T0 _ IH]; intros x u act al out t0 b H E HC t Ht;
      pose proof (last_window _ _ _ _ _ _ _ 0%nat H) as W0; simpl in W0.
    - apply (HQ _ _ _ _ _ _ _ H); [congruence | lra].
    - pose proof (last_window _ _ _ _ _ _ _ N H) as W. pose proof (pos_INR N).
      assert (R' := run_suffix _ _ _ _ _ _ _ N H ltac:(lra) ltac:(intros q Hq; apply HC; lra)).
      apply (IH x u act al out t0 b H E ltac:(lra) _ _ _ _ _ _ _ R'); rewrite ?Nat.add_0_r; auto; [| lra].
      intros q Hq. apply HC. destruct N; [lra |]. rewrite S_INR in *. pose proof (pos_INR N). nra. }
  intros x u act al out t0 b H E Kz. apply (G _ _ _ _ _ _ _ H E). apply (HK _ _ _ _ _ _ _ H). congruence.
Qed.
End Runs.
