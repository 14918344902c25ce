(* Decisions by tubes: the DM follows SC from its estimate to rest; no core, no R(H) and no P3 are needed.
   Purpose: "Decisions by tubes" of proof-flight.md: what is good, its lemma, its theorem, the first rule of rest.
   Non-goals: how tubes are computed; a DM that looks at AC's command; maps that move. *)
Require Import Reals Lra Lia Classical.
From Soter Require Import Releases Trajectories ScRuns Module Gate.
Open Scope R_scope.
Section Tubes.
Variable P : plant.
Variable answers : estimate P -> (component P -> value P) -> Prop.
Variables delta j d : R.
Hypothesis j_pos : 0 <= j. Hypothesis j_small : j < delta.
Variable Q : state P -> Prop.                  (* rest *)
Variable M : state P -> state P -> Prop.       (* M z: where SC keeps the state once it rests at z *)
Variable shown : state P -> Prop.              (* what plants can publish *)
Implicit Types (C near : state P -> Prop) (x : R -> state P) (u : R -> component P -> value P)
  (act : nat -> component P -> R) (al : nat -> R) (out : nat -> component P -> value P).

(* A rest run is an SC-run of which nothing is asked before a_0 but that plants could publish what they did. *)
Notation rest_run := (sc_run P answers delta j d shown).

(* A fall-back run, from the instant 0 of the state that was seen, looked at until b: commands of U, then SC. *)
Record fall_back near (alpha H : R) x u act al out (t0 b : R) : Prop := {
  fb_near : near (x 0);
  fb_begins : alpha <= al 0%nat <= H;
  fb_windows : forall k i, t0 + INR k * delta <= act k i <= t0 + INR k * delta + j;
  fb_last : forall k, (forall i, act k i <= al k) /\ exists i, act k i = al k;
  fb_inputs : within P (inputs P) u 0 b;
  fb_commands : forall k i t, act k i <= t < act (S k) i -> 0 <= t < b -> u t i = out k i;
  fb_reads : forall k, (exists i, act k i < b) -> exists y, answers y (out k) /\ forall p, exists q,
    0 <= q /\ al k - d <= q /\ (forall i, q <= act k i) /\ shows P p (x q) y;
  fb_flow : flow P x u 0 b }.

(* (Q, M) is a rest pair. *)
Definition rest_pair := forall x u act al out t0 b, rest_run x u act al out t0 b -> Q (x (al 0%nat)) ->
  (forall z, M (x (al 0%nat)) z -> shown z) -> forall t, al 0%nat <= t <= b -> M (x (al 0%nat)) (x t).

(* At a_N the run is at rest, and where SC keeps it from there is in C. *)
Definition rests C x al b N := al N <= b /\ Q (x (al N)) /\ forall z, M (x (al N)) z -> C z.

(* What is asked of each: in C until it is at rest, by the output N_T. C is what is safe with the map that was read. *)
Definition settles C x al b N_T :=
  (forall N, (N <= N_T)%nat -> rests C x al b N -> (forall k, (k < N)%nat -> ~ rests C x al b k) ->
    forall t, 0 <= t <= al N -> C (x t)) /\
  ((forall N, (N <= N_T)%nat -> ~ rests C x al b N) -> (forall t, 0 <= t <= b -> C (x t)) /\ b < al N_T).
Definition good near (alpha H : R) (N_T : nat) C := forall x u act al out t0 b,
  fall_back near alpha H x u act al out t0 b -> settles C x al b N_T.

(* A judgement of commands asks less: until t1 only those of V act, and SC is complete w after t1. *)
Definition held (Vi : component P -> value P -> Prop) (w : R) u al (b : R) := exists t1, 0 <= t1 <= al 0%nat /\
  al 0%nat <= t1 + w /\ forall t i, 0 <= t < t1 -> t < b -> Vi i (u t i).
Definition gated_good near Vi w (H : R) (N_T : nat) C := forall x u act al out t0 b,
  fall_back near 0 H x u act al out t0 b -> held Vi w u al b -> settles C x al b N_T.

(* What is good for the DM, the judge permits, whatever the command. *)
Lemma good_gated : forall near Vi w H N_T C, good near 0 H N_T C -> gated_good near Vi w H N_T C.
Proof. intros near Vi w H N_T C G x u act al out t0 b F _. apply (G _ _ _ _ _ _ _ F). Qed.

Lemma fall_back_ordered : forall near alpha H x u act al out t0 b N, fall_back near alpha H x u act al out t0 b ->
  t0 + INR N * delta <= al N <= t0 + INR N * delta + j /\ al 0%nat <= al N.
Proof. intros near alpha H x u act al out t0 b N F. destruct (fb_last _ _ _ _ _ _ _ _ _ _ F N) as [_ [i Ei]].
  destruct (fb_last _ _ _ _ _ _ _ _ _ _ F 0%nat) as [_ [i' Ei']].
  pose proof (fb_windows _ _ _ _ _ _ _ _ _ _ F N i). pose proof (fb_windows _ _ _ _ _ _ _ _ _ _ F 0%nat i').
  simpl in *. split; [lra |]. destruct N; [lra |]. rewrite S_INR in *. pose proof (pos_INR N). nra.
Qed.

(* From each a_N on a fall-back run is a rest run. *)
Lemma fall_back_suffix : forall near alpha H x u act al out t0 b N, fall_back near alpha H x u act al out t0 b ->
  0 <= alpha -> al N <= b -> (forall t, 0 <= t <= al N -> shown (x t)) ->
  rest_run x u (fun k => act (N + k)%nat) (fun k => al (N + k)%nat)
    (fun k => out (N + k)%nat) (t0 + INR N * delta) b.
Proof. intros near alpha H x u act al out t0 b N F A Hb HS.
  destruct (fall_back_ordered _ _ _ _ _ _ _ _ _ _ N F) as [_ O]. destruct F as [Nr B W La U Cm Rd Fl].
  apply run_suffix; auto; [| intros t Ht; apply HS; lra].
  constructor; auto; [lra | intros t T0 Ht; apply HS; lra].
Qed.

(* The implicit core: a run whose estimate is good is in C as long as it lasts. *)
Theorem good_stays : forall near alpha H N_T C, 0 <= alpha -> (forall z, C z -> shown z) -> rest_pair ->
  forall x u act al out t0 b, fall_back near alpha H x u act al out t0 b -> settles C x al b N_T ->
  (forall t, 0 <= t <= b -> C (x t)) /\ (al N_T <= b -> exists N, (N <= N_T)%nat /\ al N <= b /\ Q (x (al N)) /\
    forall t, al N <= t <= b -> M (x (al N)) (x t)).
Proof. intros near alpha H N_T C A CS RP x u act al out t0 b F [Some None].
  destruct (classic (exists N, (N <= N_T)%nat /\ rests C x al b N)) as [(N' & HN' & R') | No].
  - destruct (least (rests C x al b) N' R') as (N & R & Least).
    assert (HN : (N <= N_T)%nat) by (pose proof (Least _ R'); lia).
    assert (In : forall t, 0 <= t <= al N -> C (x t)).
    { apply (Some N HN R). intros k Hk Rk. apply Least in Rk. lia. }
    destruct R as (Rb & Rq & Rm). pose proof (RP _ _ _ _ _ _ _ (fall_back_suffix _ _ _ _ _ _ _ _ _ _ N F A Rb
      (fun t Ht => CS _ (In t Ht)))) as K. cbv beta in K. rewrite Nat.add_0_r in K.
    specialize (K Rq (fun z Hz => CS _ (Rm z Hz))). split; [| intros _; exists N; auto].
    intros t Ht. destruct (Rle_or_lt t (al N)) as [L | L]; [apply In; lra | apply Rm, K; lra].
  - destruct None as [In Late]; [intros N HN R; apply No; eauto |]. split; auto. intros L. lra.
Qed.

(* A run settles if it is in C until one of its outputs, by which it is at rest. *)
Lemma settles_by : forall near alpha H C x u act al out t0 b N_T, fall_back near alpha H x u act al out t0 b ->
  (exists N, (N <= N_T)%nat /\ (forall t, 0 <= t <= Rmin b (al N) -> C (x t)) /\ (al N <= b -> rests C x al b N)) ->
  settles C x al b N_T.
Proof. intros near alpha H C x u act al out t0 b N_T F (N & HN & In & At).
  assert (Mono : forall k m, (k <= m)%nat -> al k <= al m).
  { intros k m Hk. destruct (Nat.eq_dec k m) as [-> | Ne]; [lra |]. assert (Lt : (S k <= m)%nat) by lia.
    apply le_INR in Lt. rewrite S_INR in Lt. destruct (fall_back_ordered _ _ _ _ _ _ _ _ _ _ k F) as [Wk _].
    destruct (fall_back_ordered _ _ _ _ _ _ _ _ _ _ m F) as [Wm _]. nra. }
  split; [intros k _ [Rb Rk] Least t Ht | intros None].
  - destruct (Nat.le_gt_cases k N) as [L | G].
    + apply In. pose proof (Mono _ _ L). unfold Rmin. destruct (Rle_dec b (al N)); lra.
    + pose proof (Mono N k ltac:(lia)). exfalso. apply (Least N G), At. lra.
  - assert (b < al N) by (apply Rnot_le_lt; intros L; apply (None N HN), At, L). pose proof (Mono _ _ HN).
    split; [intros t Ht; apply In; unfold Rmin; destruct (Rle_dec b (al N)) |]; lra.
Qed.

(* A set B on the way: a run is in B at output N of its own, n1 at most, and every rest run from B is at rest n2 outputs later
   at most. B may ask of what was before. So the run settles by n1 + n2; this is asked of each run by itself, as in `good` and in `gated_good`. *)
Theorem settles_collected : forall near alpha H (B : (R -> state P) -> R -> Prop) C x u act al out t0 b n1 n2,
  fall_back near alpha H x u act al out t0 b -> 0 <= alpha -> (forall z, C z -> shown z) ->
  (exists N, (N <= n1)%nat /\ (forall t, 0 <= t <= Rmin b (al N) -> C (x t)) /\ (al N <= b -> B x (al N))) ->
  (forall x u act al out t0 b, rest_run x u act al out t0 b -> B x (al 0%nat) -> exists N, (N <= n2)%nat /\
    (forall t, al 0%nat <= t <= Rmin b (al N) -> C (x t)) /\ (al N <= b -> rests C x al b N)) ->
  settles C x al b (n1 + n2).
Proof. intros near alpha H B C x u act al out t0 b n1 n2 F A CS (N & HN & In & At) Second.
  apply (settles_by near alpha H C x u act al out t0 b); auto. destruct (Rle_or_lt (al N) b) as [L | G].
  - assert (In' : forall t, 0 <= t <= al N -> C (x t)) by (intros t Ht; apply In; unfold Rmin; destruct (Rle_dec b (al N)); lra).
    assert (R := fall_back_suffix _ _ _ _ _ _ _ _ _ _ N F A L (fun t Ht => CS _ (In' t Ht))).
    destruct (Second _ _ _ _ _ _ _ R) as (N' & HN' & In2 & At2); [rewrite Nat.add_0_r; auto |].
    rewrite Nat.add_0_r in In2. exists (N + N')%nat. split; [lia | split; [| exact At2]].
    intros t Ht. destruct (Rle_or_lt t (al N)); [apply In' | apply In2]; lra.
  - exists N. split; [lia | split; [exact In | intros; lra]].
Qed.

(* The first rule: a box B that every rest run leaves for Y only, and is in again N outputs later. *)
Theorem box_rests : forall (B Y : state P -> Prop) N, (1 <= N)%nat -> (forall z, Y z -> shown z) ->
  (forall x u act al out t0 b, rest_run x u act al out t0 b -> B (x (al 0%nat)) ->
    (forall t, al 0%nat <= t <= b -> t <= al 0%nat + INR N * delta + j -> Y (x t)) /\
    (forall t, al 0%nat <= t <= b -> INR N * delta - j <= t - al 0%nat <= INR N * delta + j -> B (x t))) ->
  keeps P answers delta j d shown B Y.
Proof. intros B Y N HN YS Hyp. apply keeps_of_chains; auto. intros z Hz. exists N. split; auto.
  intros x u act al out t0 b R E. rewrite <- E in Hz. destruct (Hyp _ _ _ _ _ _ _ R Hz) as [InY InB].
  pose proof (last_window P answers delta j d _ x u act al out t0 b 0 R) as W0.
  pose proof (last_window P answers delta j d _ x u act al out t0 b N R) as WN. simpl in W0.
  assert (1 <= INR N) by (apply (le_INR 1); exact HN).
  split; [intros t Ht; apply InY; unfold Rmin in Ht; destruct Rle_dec; lra | intros L; apply InB; nra].
Qed.

(* What may act: of each component what SC answers to a read of Y, or of a state from which Y is reached within d. *)
Definition reaches (Y : state P -> Prop) z := exists x u b, 0 <= b <= d /\ x 0 = z /\ within P (inputs P) u 0 b /\
  flow P x u 0 b /\ (forall t, 0 <= t <= b -> shown (x t)) /\ Y (x b).
Definition answered (Y : state P -> Prop) i v := exists y o, answers y o /\ v = o i /\
  forall p, exists z, (Y z \/ reaches Y z) /\ shows P p z y.

(* The second rule: z + V falls while the state is in Y, so z rises by V at most. *)
Definition falls (Y : state P -> Prop) (z V : state P -> R) := forall x u a b, a <= b -> flow P x u a b ->
  (forall t, a <= t <= b -> Y (x t)) -> (forall t i, a <= t < b -> answered Y i (u t i)) ->
  z (x b) + V (x b) <= z (x a) + V (x a).

Lemma in_force : forall x u act al out t0 b t i, rest_run x u act al out t0 b -> al 0%nat <= t ->
  exists k, act k i <= t < act (S k) i.
Proof. intros x u act al out t0 b t i R Ht. pose proof (run_windows _ _ _ _ _ _ _ _ _ _ _ _ _ R) as W.
  destruct (enough_steps (t - t0) delta) as [n Hn]; [lra |].
  destruct (last_below (fun k => act k i <= t) n) as (k & Kn & Ka & Last).
  - exists 0%nat. pose proof (proj1 (run_last _ _ _ _ _ _ _ _ _ _ _ _ _ R 0%nat) i). split; [| lra].
    destruct n; [| lia]. pose proof (W 0%nat i). simpl in *. lra.
  - exists k. split; auto. destruct (Nat.eq_dec (S k) n) as [<- | Ne]; [specialize (W (S k) i); lra |].
    apply Rnot_le_lt, Last. lia.
Qed.

Theorem potential_rests : forall Y z V, falls Y z V -> (forall s, Y s -> 0 <= V s) ->
  forall x u act al out t0 b, rest_run x u act al out t0 b -> (forall t, al 0%nat <= t <= b -> Y (x t)) ->
  forall t, al 0%nat <= t <= b -> z (x t) <= z (x (al 0%nat)) + V (x (al 0%nat)).
Proof. intros Y z V Falls Pos x u act al out t0 b R InY t Ht. specialize (Pos _ (InY t Ht)).
  cut (z (x t) + V (x t) <= z (x (al 0%nat)) + V (x (al 0%nat))); [lra |].
  pose proof (last_window P answers delta j d _ x u act al out t0 b 0 R) as W0.
  destruct (run_begins _ _ _ _ _ _ _ _ _ _ _ _ _ R) as [A0 _].
  apply (Falls x u); [lra | apply (flow_part P x u 0 b); try lra; apply (run_flow _ _ _ _ _ _ _ _ _ _ _ _ _ R) | |].
  - intros t' Ht'. apply InY. lra.
  - intros t' i Ht'. destruct (in_force _ _ _ _ _ _ _ t' i R ltac:(lra)) as [k Hk].
    pose proof (last_window P answers delta j d _ x u act al out t0 b k R) as Wk.
    assert (O : al 0%nat <= al k).
    { destruct k; [lra |]. rewrite S_INR in Wk. pose proof (pos_INR k). simpl in W0. nra. }
    destruct (run_reads _ _ _ _ _ _ _ _ _ _ _ _ _ R k) as (y & Ans & Rd); [exists i; lra |].
    exists y, (out k). split; [exact Ans | split].
    { apply (run_commands _ _ _ _ _ _ _ _ _ _ _ _ _ R); lra. }
    intros p. destruct (Rd p) as (q & Q0 & Q1 & Q2 & Q3). specialize (Q2 i). exists (x q). split; auto.
    { destruct (Rle_or_lt (al 0%nat) q) as [L | L]; [left; apply InY; lra | right].
      exists (fun r => x (r + q)), (fun r => u (r + q)), (al 0%nat - q). repeat split; try lra.
      * f_equal; lra.
      * intros r i' Hr. apply (run_inputs _ _ _ _ _ _ _ _ _ _ _ _ _ R). lra.
      * replace 0 with (q - q) by lra. apply flow_moved. apply (flow_part P x u 0 b); try lra.
        apply (run_flow _ _ _ _ _ _ _ _ _ _ _ _ _ R).
      * intros r Hr. apply (run_before _ _ _ _ _ _ _ _ _ _ _ _ _ R); lra.
      * replace (al 0%nat - q + q) with (al 0%nat) by lra. apply InY. lra. }
Qed.

(* Both: a moving state that may go both ways counts twice, as z and as -z. *)
Theorem rules_rest : forall (I : Type) (z V : I -> state P -> R) (by_ : I -> R) (B Y : state P -> Prop),
  keeps P answers delta j d shown B Y -> (forall s, Q s -> B s /\ forall i, V i s <= by_ i) ->
  (forall i, falls Y (z i) (V i) /\ forall s, Y s -> 0 <= V i s) ->
  (forall s s', Y s' -> (forall i, z i s' <= z i s + by_ i) -> M s s') -> rest_pair.
Proof. intros I z V by_ B Y K HQ HV HM x u act al out t0 b R Q0 _ t Ht. destruct (HQ _ Q0) as [B0 V0].
  assert (InY := K _ _ _ _ _ _ _ R B0). apply HM; auto. intros i. destruct (HV i) as [Fi Pi].
  pose proof (potential_rests Y (z i) (V i) Fi Pi _ _ _ _ _ _ _ R InY t Ht). specialize (V0 i). lra.
Qed.
End Tubes.

(* SC with a memory: its answers are those that it gives with any locals in La, whatever others say. *)
Section Memory.
Variable P : plant. Variables locals other : Type. Variable La : locals -> Prop.
Variable declared : estimate P -> other -> Prop.   (* the sets of the topics that SC reads *)
Variable step : estimate P -> other -> locals -> option ((component P -> value P) * locals).  (* None: a fault *)
Variable on_takeover : estimate P -> other -> locals -> option locals.
Hypothesis never_faults : forall y o l, declared y o -> La l ->
  (exists l', on_takeover y o l = Some l' /\ La l') /\
  exists v l', step y o l = Some (v, l') /\ (forall i, inputs P i (v i)) /\ La l'.
Definition any_locals y v := exists o l l', declared y o /\ La l /\ step y o l = Some (v, l').

(* l is what SC may remember before its step m, where it reads y and o; in any step it may be taking over. *)
Inductive remembers (y : nat -> estimate P) (o : nat -> other) : nat -> locals -> Prop :=
  | at_first : forall l, La l -> remembers y o 0%nat l
  | after_step : forall m l l1 v l', remembers y o m l -> l1 = l \/ on_takeover (y m) (o m) l = Some l1 ->
      step (y m) (o m) l1 = Some (v, l') -> remembers y o (S m) l'.
Theorem memory_kept : forall y o, (forall m, declared (y m) (o m)) -> forall m l, remembers y o m l ->
  on_takeover (y m) (o m) l <> None /\ forall l1, l1 = l \/ on_takeover (y m) (o m) l = Some l1 ->
    exists v l', step (y m) (o m) l1 = Some (v, l') /\ (forall i, inputs P i (v i)) /\ any_locals (y m) v.
Proof. intros y o Dc m l Rm. assert (Ok : forall k l0 l1, La l0 -> l1 = l0 \/ on_takeover (y k) (o k) l0 = Some l1 -> La l1).
  { intros k l0 l1 La0 [-> | E]; auto. destruct (never_faults _ _ _ (Dc k) La0) as [(l' & E' & La') _]. congruence. }
  assert (La l) as Ll.
  { induction Rm as [l Ll | k l0 l1 v l' _ La0 Or E]; auto.
    destruct (never_faults _ _ _ (Dc k) (Ok _ _ _ La0 Or)) as [_ (v' & l2 & E' & _ & La2)]. congruence. }
  split; [destruct (never_faults _ _ _ (Dc m) Ll) as [(l' & E & _) _]; congruence |].
  intros l1 Or. assert (La1 := Ok _ _ _ Ll Or). destruct (never_faults _ _ _ (Dc m) La1) as [_ (v & l' & E & U & _)].
  exists v, l'. repeat split; auto. exists (o m), l1, l'. auto.
Qed.
End Memory.

Section Decided.
Variable P : plant. Variable T : times.
Variable answers : estimate P -> (component P -> value P) -> Prop.
Variable ex : @execution P T answers. Hypothesis TH : times_hold T.
Variable map : Type. Variable safe_with : map -> state P -> Prop.  (* C_m *)
Variable Q : state P -> Prop. Variable M : state P -> state P -> Prop. Variable shown : state P -> Prop.
Hypothesis safe_shown : forall m z, safe_with m z -> shown z.
Hypothesis rest : rest_pair P answers (delta T) (window T) (state_age T) Q M shown.
Variable H : R. Variable N_T : nat.
Hypothesis P1c : H_star T <= H.
Definition alpha := Rmax (Delta T - dm_late T + L_min T) (H - delta T - window T).
Notation good := (good P answers (delta T) (window T) (state_age T) Q M).

(* What DM and SC read, and when it was so: SC each topic at a time of its own. SC's output m counts: all that it reads of
   plants was available. *)
Variable dm_seen : nat -> R. Variable sc_seen : nat -> topic P -> R.
Variable estimate_of : nat -> estimate P. Variable map_of : nat -> map.
Hypothesis sc_reads : forall m, counts ex m -> exists y, answers y (out ex m) /\ forall p, 0 <= sc_seen m p /\
  sc_start ex m - sc_age T <= sc_seen m p <= sc_start ex m /\ shows P p (x ex (sc_seen m p)) y.
Hypothesis verdicts : forall k, says_ac ex k -> 0 <= dm_seen k /\
  dm_start ex k - age T <= dm_seen k <= dm_start ex k /\ reads_as P (x ex (dm_seen k)) (estimate_of k) /\
  good (fun z => reads_as P z (estimate_of k)) alpha H N_T (safe_with (map_of k)).
(* The execution is one of the model until `ends`: a plant that cannot publish its state would end it. *)
Variable ends : R.
(* SC sees plants only by what the check reads, and who starts later reads no older state. *)
Hypothesis reads_go_on : forall k m, says_ac ex k -> dm_start ex k <= sc_start ex m -> sc_out ex m < ends ->
  counts ex m /\ forall p, dm_seen k <= sc_seen m p.

Lemma alpha_in : 0 <= Delta T - dm_late T + L_min T /\ 0 <= alpha <= H.
Proof. pose proof (not_negative T TH). pose proof (periods T TH). pose proof (window_pos T TH). pose proof (no_overlap T TH).
  pose proof (Rmax_l (dm_late T + dm_response T) (G T + sc_late T)).
  unfold alpha, H_star in *. split; [lra |]. unfold Rmax at 1 2. destruct Rle_dec; lra.
Qed.

(* If an output is complete by e there is a last one, and the next one is due soon. *)
Lemma last_complete : forall e m1, complete ex m1 <= e ->
  exists m, (m1 <= m)%nat /\ e - delta T - window T <= complete ex m <= e.
Proof. intros e m1 H1. pose proof (periods T TH). destruct (enough_steps e (delta T)) as [n Hn]; [lra |].
  assert (Far : forall m, sc_release T m <= complete ex m) by (intros m;
    pose proof (sc_window P T answers ex TH m); pose proof (not_negative T TH); lra).
  assert (Late : (m1 < n)%nat).
  { destruct (Nat.le_gt_cases n m1) as [L | L]; auto. apply le_INR in L. pose proof (Far m1).
    pose proof (not_negative T TH). unfold sc_release in *. nra. }
  destruct (last_below (fun m => complete ex m <= e) n) as (m & Mn & Me & Mx); [exists m1; auto |].
  assert (Mm : (m1 <= m)%nat) by (destruct (Nat.le_gt_cases m1 m); auto; exfalso; apply (Mx m1); auto).
  exists m. split; auto. split; auto. assert (Next : e < complete ex (S m)).
  { destruct (Nat.eq_dec (S m) n) as [<- | Ne]; [| apply Rnot_le_lt, Mx; lia].
    pose proof (Far (S m)). pose proof (not_negative T TH). unfold sc_release in *. lra. }
  pose proof (sc_window P T answers ex TH m). pose proof (sc_window P T answers ex TH (S m)).
  unfold window, sc_release in *. rewrite S_INR in *. lra.
Qed.

(* An execution from s on is a fall-back run: nothing but U acts until b, or SC is complete at m, and alone from there. *)
Definition alone_from s a h b := exists m, s + a <= complete ex m <= s + h /\ complete ex m <= b /\
  (forall n, (m <= n)%nat -> sc_out ex n < b -> counts ex n /\ forall p, s <= sc_seen n p) /\
  forall t, sc_out ex m <= t < b -> ~ ac_mode ex t.
Lemma is_fall_back : forall (near : state P -> Prop) s a h b, 0 <= s <= b -> near (x ex s) -> a <= h ->
  b <= s + h \/ alone_from s a h b ->
  exists act al out t0, fall_back P answers (delta T) (window T) (state_age T) near a h
    (fun t => x ex (t + s)) (fun t => u ex (t + s)) act al out t0 (b - s).
Proof. intros near s a h b Sb Nr Ah Cases.
  assert (Fl : flow P (fun t => x ex (t + s)) (fun t => u ex (t + s)) 0 (b - s)).
  { replace 0 with (s - s) by lra. apply flow_moved. apply moves_from. lra. }
  assert (U : within P (inputs P) (fun t => u ex (t + s)) 0 (b - s)).
  { intros t i Ht. apply (U_only P T answers ex 0 b); lra. }
  pose proof (periods T TH) as Pd. pose proof (window_pos T TH) as Wp.
  destruct Cases as [Short | (m & Mh & Mb & Cn & Alone)].
  - exists (fun k _ => h + INR k * delta T), (fun k => h + INR k * delta T), (out ex), h.
    constructor; auto; try (intros; simpl; lra).
    + rewrite Rplus_0_l. exact Nr.
    + intros k. split; [intros; lra |]. destruct (sc_complete ex 0%nat) as [_ [i _]]. exists i. reflexivity.
    + intros k i t [Ht _] Hb. pose proof (pos_INR k). nra.
    + intros k [i Hi]. pose proof (pos_INR k). nra.
  - assert (Run := sc_run_begins P T answers ex TH (fun _ => True) m b (fun n Hn Hb => proj1 (Cn n Hn Hb)) Mb
      (fun _ _ => I) Alone). destruct Run as [W La Bg _ _ Cm _ _].
    exists (fun k i => acts ex (m + k)%nat i - s), (fun k => complete ex (m + k)%nat - s),
      (fun k => out ex (m + k)%nat), (sc_release T m + L_min T - s). constructor; auto.
    + rewrite Rplus_0_l. exact Nr.
    + rewrite Nat.add_0_r. lra.
    + intros k i. specialize (W k i). lra.
    + intros k. destruct (La k) as [L1 [i L2]]. split; [intros i'; specialize (L1 i'); lra | exists i; lra].
    + intros k i t Ht Hb. apply (Cm k i (t + s)); lra.
    + intros k [i0 Hi0]. pose proof (sc_acts ex (m + k)%nat i0). pose proof (not_negative T TH).
      destruct (Cn (m + k)%nat ltac:(lia) ltac:(lra)) as [Ct Ss]. destruct (sc_reads _ Ct) as (y & Ans & Rd).
      exists y. split; auto. intros p. destruct (Rd p) as (S0 & S1 & S2). specialize (Ss p). exists (sc_seen (m + k)%nat p - s).
      pose proof (sc_window P T answers ex TH (m + k)%nat). pose proof (sc_publishes ex (m + k)%nat).
      unfold state_age. repeat split; [lra | lra | |].
      * intros i. pose proof (sc_acts ex (m + k)%nat i). lra.
      * replace (sc_seen (m + k)%nat p - s + s) with (sc_seen (m + k)%nat p) by lra. exact S2.
Qed.

(* So where it is good it stays safe, and comes to rest if it is given the time. *)
Lemma decided : forall (near : state P -> Prop) s a h b m, 0 <= s <= b -> near (x ex s) -> 0 <= a <= h ->
  b <= s + h \/ alone_from s a h b ->
  good near a h N_T (safe_with m) -> (forall t, s <= t <= b -> safe_with m (x ex t)) /\
  (s + h + INR N_T * delta T + window T <= b -> exists t, s + a <= t <= s + h + INR N_T * delta T + window T /\
    Q (x ex t) /\ forall t', t <= t' <= b -> M (x ex t) (x ex t')).
Proof. intros near s a h b m Sb Nr Ah Cases G.
  destruct (is_fall_back near s a h b Sb Nr ltac:(lra) Cases) as (act & al & o & t0 & F).
  pose proof (window_pos T TH) as Wp.
  destruct (good_stays P answers (delta T) (window T) (state_age T) ltac:(lra) ltac:(lra) Q M shown near a h N_T
    (safe_with m) ltac:(lra) (safe_shown m) rest _ _ _ _ _ _ _ F (G _ _ _ _ _ _ _ F)) as [In Rest]. split.
  - intros t Ht. replace t with (t - s + s) by lra. apply (In (t - s)). lra.
  - intros L. assert (Or : forall N, t0 + INR N * delta T <= al N <= t0 + INR N * delta T + window T /\ al 0%nat <= al N)
      by (intros N; eapply fall_back_ordered; [lra | exact F]).
    pose proof (fb_begins _ _ _ _ _ _ _ _ _ _ _ _ _ _ _ F) as Bg. destruct (Or 0%nat) as [O0 _]. simpl in O0.
    destruct Rest as (N & HN & _ & Qn & Mn); [destruct (Or N_T); lra |]. exists (al N + s). split; [| split; auto].
    + destruct (Or N) as [ON O1]. apply le_INR in HN. pose proof (periods T TH). nra.
    + intros t' Ht'. replace t' with (t' - s + s) by lra. apply Mn. lra.
Qed.

(* The lemma: from a verdict "AC" until b, before which no other one is in force. *)
Lemma takes_over : forall n b, says_ac ex n -> (forall k, (n < k)%nat -> dm_out ex k < b -> ~ says_ac ex k) ->
  dm_seen n + H < b <= ends -> alone_from (dm_seen n) alpha H b.
Proof. intros n b Ac No [Hb Hends]. destruct (verdicts n Ac) as (S0 & S1 & _). pose proof (not_negative T TH) as NN.
  destruct (dm_window P T answers ex TH n) as (D1 & D2 & D3 & D4 & D5).
  destruct (dm_window P T answers ex TH (S n)) as (E1 & E2 & _).
  assert (Rel : dm_release T (S n) = dm_release T n + Delta T) by (unfold dm_release; rewrite S_INR; ring).
  destruct (takes_over_in_time P T answers ex TH n) as (m1 & M1 & M2 & M3).
  destruct (last_complete (dm_seen n + H) m1) as (m & Mm & Me); [lra |].
  assert (Started : forall n', (m <= n')%nat -> dm_out ex (S n) <= sc_start ex n').
  { intros n' Hn'. apply (sc_waits ex). assert (Q' : (m1 <= n')%nat) by lia. apply le_INR in Q'.
    pose proof (periods T TH). unfold sc_release in *. nra. }
  pose proof (Started m (le_n m)). pose proof (sc_publishes ex m). pose proof (sc_window P T answers ex TH m).
  pose proof (dm_starts ex n). exists m. split; [| split; [lra | split]].
  - split; [| lra]. unfold alpha, Rmax. destruct Rle_dec; lra.
  - intros n' Hn' Nb. apply reads_go_on; auto; [| lra]. pose proof (Started n' Hn'). lra.
  - intros t Ht (k & Hk & Ack & Last). assert (S n <= k)%nat by (apply Last; lra). apply (No k); [lia | lra | auto].
Qed.

(* (a) A verdict "AC" on a state of time s with map m: until the next one is in force, or for ever, the state is in C_m. *)
Theorem verdict_safe : forall n b, says_ac ex n -> (forall k, (n < k)%nat -> dm_out ex k < b -> ~ says_ac ex k) ->
  b <= ends -> forall t, dm_seen n <= t <= b -> safe_with (map_of n) (x ex t).
Proof. intros n b Ac No Hends t Ht. destruct (verdicts n Ac) as (S0 & S1 & S2 & G). destruct alpha_in as [_ A].
  refine (proj1 (decided _ (dm_seen n) alpha H b (map_of n) _ S2 A _ G) t Ht); [lra |].
  destruct (Rle_or_lt b (dm_seen n + H)); [left; auto | right; apply takes_over; auto].
Qed.

(* If no other verdict "AC" comes for so long, SC brings it to rest, and keeps it there. *)
Definition at_rest_by n := dm_seen n + H + INR N_T * delta T + window T.
Theorem verdict_rests : forall n b, says_ac ex n -> at_rest_by n <= b <= ends ->
  (forall k, (n < k)%nat -> dm_out ex k < b -> ~ says_ac ex k) ->
  exists t, dm_seen n <= t <= at_rest_by n /\ Q (x ex t) /\ forall t', t <= t' <= b -> M (x ex t) (x ex t').
Proof. unfold at_rest_by. intros n b Ac [Hb Hends] No. destruct (verdicts n Ac) as (S0 & S1 & S2 & G).
  destruct alpha_in as [_ A]. pose proof (periods T TH). pose proof (window_pos T TH). pose proof (pos_INR N_T).
  assert (0 <= INR N_T * delta T) by (apply Rmult_le_pos; lra).
  destruct (decided (fun z => reads_as P z (estimate_of n)) (dm_seen n) alpha H b (map_of n) ltac:(lra) S2 A)
    as [_ (t & Ht & Qt)]; [| exact G | exact Hb | exists t; split; auto; lra].
  destruct (Rle_or_lt b (dm_seen n + H)); [left; auto | right; apply takes_over; auto].
Qed.

(* Control is back, if at rest the DM reads fresh and finds it good; so long after SC's first output acts. *)
Theorem decided_returns : forall n, says_ac ex n ->
  at_rest_by n + age T + Delta T + dm_late T + dm_response T <= ends ->
  (forall k, at_rest_by n <= dm_start ex k -> dm_start ex k - age T <= dm_seen k <= dm_start ex k /\
    forall z, Q z -> M z (x ex (dm_seen k)) -> says_ac ex k) ->
  exists k, (n < k)%nat /\ says_ac ex k /\
    dm_out ex k <= at_rest_by n + age T + Delta T + dm_late T + dm_response T /\
    forall m i, dm_out ex (S n) <= sc_out ex m -> dm_out ex k <= acts ex m i +
      (H - Delta T + dm_late T - L_min T) + (INR N_T * delta T + window T) + age T + Delta T + dm_late T + dm_response T.
Proof. intros n Ac Hends Fresh. pose proof (not_negative T TH) as NN. pose proof (periods T TH). pose proof (window_pos T TH).
  pose proof (pos_INR N_T). assert (0 <= INR N_T * delta T) by (apply Rmult_le_pos; lra).
  destruct (verdicts n Ac) as (S0 & S1 & _). destruct alpha_in as [_ A].
  set (b := at_rest_by n + age T + Delta T + dm_late T + dm_response T).
  assert (exists k, (n < k)%nat /\ says_ac ex k /\ dm_out ex k <= b) as (k & Nk & Ack & Kb).
  { apply NNPP. intros No. destruct (verdict_rests n b Ac) as (t & Ht & Qt & Mt); [split; [unfold b; lra | exact Hends] | |].
    { intros k Nk Kb Ack. apply No. exists k. repeat split; auto; lra. }
    destruct (next_release (dm_phase T) (Delta T) (at_rest_by n + age T)) as [k Hk]; [lra | unfold at_rest_by; lra |].
    change (dm_phase T + INR k * Delta T) with (dm_release T k) in Hk.
    destruct (dm_window P T answers ex TH k) as (D1 & D2 & D3 & _). destruct (Fresh k ltac:(lra)) as [F1 F2].
    assert (Kb : dm_out ex k <= b) by (unfold b; lra). apply No. exists k. repeat split; auto.
    - destruct (Nat.le_gt_cases k n) as [L | L]; auto. apply (dm_out_order P T answers ex TH) in L.
      destruct (dm_window P T answers ex TH n) as (E1 & E2 & E3 & _). pose proof (dm_starts ex n).
      unfold at_rest_by, H_star in *. pose proof (Rmax_l (dm_late T + dm_response T) (G T + sc_late T)). lra.
    - apply (F2 (x ex t)); auto. apply Mt. unfold b. lra. }
  exists k. repeat split; auto. intros m i Hm. pose proof (sc_acts ex m i). pose proof (dm_starts ex n).
  destruct (dm_window P T answers ex TH (S n)) as (E1 & E2 & _).
  assert (Rel : dm_release T (S n) = dm_release T n + Delta T) by (unfold dm_release; rewrite S_INR; ring).
  unfold b, at_rest_by in Kb. lra.
Qed.

(* The start: with no error, and until h_0 any command. SC's outputs from number m0 on count. *)
Variable m0 : nat. Variable q : R. Variable map_0 : map.
Hypothesis counts_from : forall m, (m0 <= m)%nat -> sc_out ex m < ends -> counts ex m.
Hypothesis q_last : forall k, dm_release T k <= sc_release T m0 -> dm_release T k <= q.
Notation h0 := (h_0 T (sc_release T m0) q).
Definition alpha_0 := Rmax 0 (h0 - delta T - window T).
Hypothesis start : good (eq (x ex 0)) alpha_0 h0 N_T (safe_with map_0).
Theorem start_safe : forall b, (forall k, dm_out ex k < b -> ~ says_ac ex k) -> b <= ends ->
  forall t, 0 <= t <= b -> safe_with map_0 (x ex t).
Proof. intros b No Hends t Ht. pose proof (first_in_time P T answers ex TH m0 q q_last) as First.
  pose proof (sc_window P T answers ex TH m0). pose proof (not_negative T TH). pose proof (periods T TH).
  pose proof (window_pos T TH). assert (A : 0 <= alpha_0 <= h0) by (unfold alpha_0, Rmax; destruct Rle_dec; lra).
  refine (proj1 (decided (eq (x ex 0)) 0 alpha_0 h0 b map_0 _ eq_refl A _ start) t Ht); [lra |].
  destruct (Rle_or_lt b (0 + h0)) as [L | L]; [left; auto | right].
  destruct (last_complete h0 m0 First) as (m & Mm & Me). exists m. pose proof (sc_window P T answers ex TH m) as Wm.
  repeat split; try lra.
  - unfold alpha_0, Rmax. destruct Rle_dec; lra.
  - apply counts_from; [lia | lra].
  - intros p. edestruct sc_reads as (y & _ & Rd); [| apply (Rd p)]. apply counts_from; [lia | lra].
  - intros t' Ht' (k & Hk & Ack & _). apply (No k); auto. lra.
Qed.

(* (b) What is safe for ever: every map that was read shows less. *)
Variable C : state P -> Prop.
Hypothesis map_0_true : forall z, safe_with map_0 z -> C z.
Hypothesis maps_true : forall k, says_ac ex k -> forall z, safe_with (map_of k) z -> C z.
Theorem implicit_safe : forall t, 0 <= t <= ends -> C (x ex t).
Proof. intros t [T0 Te]. destruct (verdicts_go_on P T answers ex TH t) as [n Hn].
  destruct (classic (exists k, (k < n)%nat /\ (dm_out ex k < t /\ says_ac ex k))) as [Some | None].
  - destruct (last_below (fun k => dm_out ex k < t /\ says_ac ex k) n Some) as (k & Kn & [Kt Ack] & Last).
    apply (maps_true k Ack), (verdict_safe k t Ack); auto.
    + intros k' Hk' Ht Ac. apply (Last k'); auto. split; auto. destruct (Nat.le_gt_cases n k') as [L |]; auto.
      apply (dm_out_order P T answers ex TH) in L. lra.
    + destruct (verdicts k Ack) as (_ & S1 & _). pose proof (dm_answers ex k). lra.
  - apply map_0_true, (start_safe t); [| exact Te | lra]. intros k Kt Ack. apply None. exists k. split; auto.
    destruct (Nat.le_gt_cases n k) as [L |]; auto. apply (dm_out_order P T answers ex TH) in L. lra.
Qed.

(* The same where commands are judged when they are published: V, as in Gate.v, in the place of U until SC's first output
   acts. Each judgement has read a map and a state, and what starts later reads no older state. *)
Variable judgement : R -> R -> Prop.
Definition takeover_time := H_star T - age T - Delta T - L_min T.
Hypothesis judged_good : forall s now, judgement s now -> 0 <= s <= now /\ exists y m, reads_as P (x ex s) y /\
  (forall z, safe_with m z -> C z) /\
  gated_good P answers (delta T) (window T) (state_age T) Q M (fun z => reads_as P z y) (may_act P T answers ex s now)
    takeover_time H N_T (safe_with m).
Hypothesis silence : forall k, says_ac ex k -> exists s now, judgement s now /\ dm_release T k - age T <= s /\
  dm_start ex k <= now <= dm_out ex k /\
  forall i e a v, emitted ex i e a v -> now < e <= dm_out ex k -> ac_mode ex e.
Hypothesis judged : forall i e a v, emitted ex i e a v -> 0 <= e -> ac_mode ex e ->
  exists s, judgement s e /\ forall k, dm_start ex k <= e -> dm_release T k - age T <= s.
Hypothesis finitely_many : forall t, (exists i e a v, emitted ex i e a v /\ e < t) ->
  exists i e a v, emitted ex i e a v /\ e < t /\ forall i' e' a' v', emitted ex i' e' a' v' -> e' < t -> e' <= e.
Hypothesis judges_read_first : forall s now m, judgement s now -> now <= sc_start ex m -> sc_out ex m < ends ->
  counts ex m /\ forall p, s <= sc_seen m p.
Theorem gated_safe : forall t, 0 <= t <= ends -> C (x ex t).
Proof. intros t [T0 Te]. destruct (verdicts_go_on P T answers ex TH t) as [n' Hn'].
  destruct (least (fun n => t <= dm_out ex n) n' Hn') as (n & Hn & Least).
  assert (Before : forall k, dm_out ex k < t -> (k < n)%nat).
  { intros k Hk. destruct (Nat.le_gt_cases n k) as [L | L]; auto. apply (dm_out_order P T answers ex TH) in L. lra. }
  destruct (classic (exists k, (k < n)%nat /\ says_ac ex k)) as [Some | None].
  2: { apply map_0_true, (start_safe t); [| exact Te | lra]. intros k Kt Ack. apply None. exists k. auto. }
  destruct (last_below (says_ac ex) n Some) as (j & Jn & Acj & NoAc).
  assert (Jt : dm_out ex j < t) by (apply Rnot_le_lt; intros L; apply Least in L; lia).
  destruct (dm_window P T answers ex TH j) as (D1 & D2 & D3 & D4 & D5). pose proof (not_negative T TH) as NN.
  destruct (dm_window P T answers ex TH (S j)) as (F1 & F2 & _ & _ & F5).
  assert (Rel : dm_release T (S j) = dm_release T j + Delta T) by (unfold dm_release; rewrite S_INR; ring).
  destruct (first_to_pass P T answers ex TH j n NoAc) as (mx & m1 & Mle & Mx1 & M1 & M2 & M3 & No & ScOnly).
  pose proof (sc_window P T answers ex TH mx) as Wx. pose proof (sc_window P T answers ex TH m1) as W1.
  pose proof (sc_out_order P T answers ex TH mx m1 Mle) as Ox.
  set (b := Rmin t (sc_out ex mx)). assert (B : b <= t /\ b <= sc_out ex mx /\ (t <= b \/ sc_out ex mx <= b))
    by (unfold b, Rmin; destruct Rle_dec; lra). clearbody b. destruct B as (B1 & B2 & B3).
  destruct (last_judgement P T answers ex TH judgement (fun s now G => proj1 (judged_good s now G)) silence judged
    finitely_many j b Acj ltac:(destruct B3; lra)) as (s & now & G & Sb & Nb & Em).
  { intros i e a v E He. destruct (Rlt_or_le e (dm_out ex (S j))) as [Q' | Q'];
      [apply (ac_mode_until P T answers ex TH j); auto; lra |].
    destruct (ScOnly _ _ _ _ E ltac:(lra)). lra. }
  destruct (judged_good s now G) as (S0 & y & m & Ry & True_m & Gd). apply True_m.
  assert (Now : now <= dm_out ex (S j)).
  { destruct Nb as [Nb | [Nb1 Nb2]]; [lra |]. apply Rnot_lt_le. intros L. apply (No now); auto; lra. }
  set (h := complete ex m1 - s). assert (Hh : 0 <= h <= H) by (unfold h; lra).
  destruct (is_fall_back (fun z => reads_as P z y) s h h t ltac:(lra) Ry ltac:(lra)) as (act & al & o & t0 & F).
  { destruct (Rle_or_lt t (complete ex m1)) as [L | L]; [left; unfold h; lra | right]. exists m1.
    split; [unfold h; lra | split; [lra | split]].
    - intros k Hk Kt. apply (judges_read_first s now); auto; [| lra]. pose proof (periods T TH) as Pd.
      assert (dm_out ex (S j) <= sc_start ex k); [| lra]. apply (sc_waits ex). apply le_INR in Hk.
      unfold sc_release in *. nra.
    - intros t' Ht'. apply No. lra. }
  pose proof (fb_begins _ _ _ _ _ _ _ _ _ _ _ _ _ _ _ F) as Bg.
  assert (F' : fall_back P answers (delta T) (window T) (state_age T) (fun z => reads_as P z y) 0 H
    (fun t => x ex (t + s)) (fun t => u ex (t + s)) act al o t0 (t - s)) by (destruct F; constructor; auto; lra).
  pose proof (window_pos T TH) as Wp.
  replace t with (t - s + s) by lra.
  refine (proj1 (good_stays P answers (delta T) (window T) (state_age T) ltac:(lra) ltac:(lra) Q M shown _ 0 H N_T
    (safe_with m) ltac:(lra) (safe_shown m) rest _ _ _ _ _ _ _ F' (Gd _ _ _ _ _ _ _ F' _)) (t - s) _); [| lra].
  exists (sc_out ex mx + L_min T - s). split; [unfold h in *; lra | split; [unfold takeover_time, h in *; lra |]].
  intros r i Hr Hr'. apply (V_acts P T answers ex s now b (Rmin t (sc_out ex mx + L_min T))); auto; [lra | |].
  - intros i' e a v E He Ha. destruct (emitted_in_U ex _ _ _ _ E) as [Ea _]. unfold Rmin in Ha.
    destruct (Rlt_or_le e (dm_out ex n)) as [Q' | Q']; [destruct B3 as [B3 | B3] |]; destruct Rle_dec; try lra;
      destruct (ScOnly _ _ _ _ E); lra.
  - unfold Rmin. destruct Rle_dec; lra.
Qed.
End Decided.
