(* Decisions by tubes: the DM follows SC from its estimate to rest; no core, no R(H) and no P3 are needed.
   Purpose: "Decisions by tubes" of docs/proof.md: what is good, its lemma, its theorem, the first rule of rest.
   Non-goals: how tubes are computed; a DM that looks at AC's command; maps that move. *)
Require Import Reals Lra Lia Classical.
From Soter Require Import Releases Trajectories ScRuns Module.
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

(* A rest run is an SC-run of which nothing is asked before a_0. *)
Notation rest_run := (sc_run P answers delta j d (fun _ => True)).

(* A fall-back run, from the instant 0 of the state that was seen, looked at until b: commands of U, then SC. *)
Record fall_back near (alpha H : R) x u act al out (t0 b : R) : Prop := {
  fb_near : near (x 0);
  fb_begins : alpha <= al 0%nat <= H;
  fb_windows : forall k i, t0 + INR k * delta <= act k i <= t0 + INR k * delta + j;
  fb_last : forall k, (forall i, act k i <= al k) /\ exists i, act k i = al k;
  fb_inputs : within P (inputs P) u 0 b;
  fb_commands : forall k i t, act k i <= t < act (S k) i -> 0 <= t < b -> u t i = out k i;
  fb_reads : forall k, (exists i, act k i < b) -> exists q y, 0 <= q /\ al k - d <= q /\
    (forall i, q <= act k i) /\ reads_as P (x q) y /\ answers y (out k);
  fb_flow : flow P x u 0 b }.

(* (Q, M) is a rest pair. *)
Definition rest_pair := forall x u act al out t0 b, rest_run x u act al out t0 b -> Q (x (al 0%nat)) ->
  (forall z, M (x (al 0%nat)) z -> shown z) -> forall t, al 0%nat <= t <= b -> M (x (al 0%nat)) (x t).

(* At a_N the run is at rest, and where SC keeps it from there is in C. *)
Definition rests C x al b N := al N <= b /\ Q (x (al N)) /\ forall z, M (x (al N)) z -> C z.

(* What the DM asks. C is the set of states that are safe with the map that it has read. *)
Definition good near (alpha H : R) (N_T : nat) C := forall x u act al out t0 b,
  fall_back near alpha H x u act al out t0 b ->
  (forall N, (N <= N_T)%nat -> rests C x al b N -> (forall k, (k < N)%nat -> ~ rests C x al b k) ->
    forall t, 0 <= t <= al N -> C (x t)) /\
  ((forall N, (N <= N_T)%nat -> ~ rests C x al b N) -> (forall t, 0 <= t <= b -> C (x t)) /\ b < al N_T).

Lemma fall_back_ordered : forall near alpha H x u act al out t0 b N, fall_back near alpha H x u act al out t0 b ->
  t0 + INR N * delta <= al N <= t0 + INR N * delta + j /\ al 0%nat <= al N.
Proof. intros near alpha H x u act al out t0 b N F. destruct (fb_last _ _ _ _ _ _ _ _ _ _ F N) as [_ [i Ei]].
  destruct (fb_last _ _ _ _ _ _ _ _ _ _ F 0%nat) as [_ [i' Ei']].
  pose proof (fb_windows _ _ _ _ _ _ _ _ _ _ F N i). pose proof (fb_windows _ _ _ _ _ _ _ _ _ _ F 0%nat i').
  simpl in *. split; [lra |]. destruct N; [lra |]. rewrite S_INR in *. pose proof (pos_INR N). nra.
Qed.

(* From each a_N on a fall-back run is a rest run. *)
Lemma fall_back_suffix : forall near alpha H x u act al out t0 b N, fall_back near alpha H x u act al out t0 b ->
  0 <= alpha -> al N <= b -> rest_run x u (fun k => act (N + k)%nat) (fun k => al (N + k)%nat)
    (fun k => out (N + k)%nat) (t0 + INR N * delta) b.
Proof. intros near alpha H x u act al out t0 b N F A Hb. destruct (fall_back_ordered _ _ _ _ _ _ _ _ _ _ N F) as [_ O].
  destruct F as [Nr B W La U Cm Rd Fl]. apply run_suffix; auto. constructor; auto. lra.
Qed.

(* The implicit core: a run whose estimate is good is in C as long as it lasts. *)
Theorem good_stays : forall near alpha H N_T C, 0 <= alpha -> (forall z, C z -> shown z) -> rest_pair ->
  good near alpha H N_T C -> forall x u act al out t0 b, fall_back near alpha H x u act al out t0 b ->
  (forall t, 0 <= t <= b -> C (x t)) /\ (al N_T <= b -> exists N, (N <= N_T)%nat /\ rests C x al b N).
Proof. intros near alpha H N_T C A CS RP G x u act al out t0 b F. destruct (G _ _ _ _ _ _ _ F) as [Some None].
  destruct (classic (exists N, (N <= N_T)%nat /\ rests C x al b N)) as [(N' & HN' & R') | No].
  - destruct (least (rests C x al b) N' R') as (N & R & Least).
    assert (HN : (N <= N_T)%nat) by (pose proof (Least _ R'); lia).
    split; [| intros _; exists N; auto]. intros t Ht. destruct (Rle_or_lt t (al N)) as [L | L].
    + apply (Some N HN R); [| lra]. intros k Hk Rk. apply Least in Rk. lia.
    + destruct R as (Rb & Rq & Rm). apply Rm.
      pose proof (RP _ _ _ _ _ _ _ (fall_back_suffix _ _ _ _ _ _ _ _ _ _ N F A Rb)) as K.
      cbv beta in K. rewrite Nat.add_0_r in K. apply K; auto. lra.
  - destruct None as [In Late]; [intros N HN R; apply No; eauto |]. split; auto. intros L. lra.
Qed.

(* The first rule: a box B that every rest run leaves for Y only, and is in again N outputs later. *)
Theorem box_rests : forall (B Y : state P -> Prop) N, (1 <= N)%nat ->
  (forall x u act al out t0 b, rest_run x u act al out t0 b -> B (x (al 0%nat)) ->
    (forall t, al 0%nat <= t <= b -> t <= al 0%nat + INR N * delta + j -> Y (x t)) /\
    (forall t, al 0%nat <= t <= b -> INR N * delta - j <= t - al 0%nat <= INR N * delta + j -> B (x t))) ->
  keeps P answers delta j d (fun _ => True) B Y.
Proof. intros B Y N HN Hyp. apply keeps_of_chains; auto. intros z Hz. exists N. split; auto.
  intros x u act al out t0 b R E. rewrite <- E in Hz. destruct (Hyp _ _ _ _ _ _ _ R Hz) as [InY InB].
  pose proof (last_window P answers delta j d _ x u act al out t0 b 0 R) as W0.
  pose proof (last_window P answers delta j d _ x u act al out t0 b N R) as WN. simpl in W0.
  assert (1 <= INR N) by (apply (le_INR 1); exact HN).
  split; [intros t Ht; apply InY; unfold Rmin in Ht; destruct Rle_dec; lra | intros L; apply InB; nra].
Qed.
End Tubes.

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

(* What DM and SC read, and when it was so. SC's output m counts: all that it reads of plants was available. *)
Variable dm_seen sc_seen : nat -> R. Variable estimate_of : nat -> estimate P. Variable map_of : nat -> map.
Hypothesis sc_reads : forall m, counts ex m -> 0 <= sc_seen m /\ sc_start ex m - sc_age T <= sc_seen m <= sc_start ex m /\
  exists y, reads_as P (x ex (sc_seen m)) y /\ answers y (out ex m).
Hypothesis verdicts : forall k, says_ac ex k -> 0 <= dm_seen k /\
  dm_start ex k - age T <= dm_seen k <= dm_start ex k /\ reads_as P (x ex (dm_seen k)) (estimate_of k) /\
  good (fun z => reads_as P z (estimate_of k)) alpha H N_T (safe_with (map_of k)).
(* SC sees plants only by what the check reads, and who starts later reads no older state. *)
Hypothesis reads_go_on : forall k m, says_ac ex k -> dm_start ex k <= sc_start ex m ->
  counts ex m /\ dm_seen k <= sc_seen m.

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
Lemma is_fall_back : forall (near : state P -> Prop) s a h b, 0 <= s <= b -> near (x ex s) -> a <= h ->
  b <= s + h \/ (exists m, s + a <= complete ex m <= s + h /\ complete ex m <= b /\
    (forall n, (m <= n)%nat -> counts ex n /\ s <= sc_seen n) /\
    forall t, sc_out ex m <= t < b -> ~ ac_mode ex t) ->
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
  - assert (Run := sc_run_begins P T answers ex TH (fun _ => True) m b (fun n Hn => proj1 (Cn n Hn)) Mb
      (fun _ _ => I) Alone). destruct Run as [W La Bg _ _ Cm _ _].
    exists (fun k i => acts ex (m + k)%nat i - s), (fun k => complete ex (m + k)%nat - s),
      (fun k => out ex (m + k)%nat), (sc_release T m + L_min T - s). constructor; auto.
    + rewrite Rplus_0_l. exact Nr.
    + rewrite Nat.add_0_r. lra.
    + intros k i. specialize (W k i). lra.
    + intros k. destruct (La k) as [L1 [i L2]]. split; [intros i'; specialize (L1 i'); lra | exists i; lra].
    + intros k i t Ht Hb. apply (Cm k i (t + s)); lra.
    + intros k _. destruct (Cn (m + k)%nat ltac:(lia)) as [Ct Ss].
      destruct (sc_reads _ Ct) as (S0 & S1 & y & S2 & S3). exists (sc_seen (m + k)%nat - s), y.
      pose proof (sc_window P T answers ex TH (m + k)%nat). pose proof (sc_publishes ex (m + k)%nat).
      unfold state_age. repeat split; auto; [lra | lra | |].
      * intros i. pose proof (sc_acts ex (m + k)%nat i). pose proof (not_negative T TH). lra.
      * replace (sc_seen (m + k)%nat - s + s) with (sc_seen (m + k)%nat) by lra. exact S2.
Qed.

(* So where it is good it stays safe, and comes to rest if it is given the time. *)
Lemma decided : forall (near : state P -> Prop) s a h b m, 0 <= s <= b -> near (x ex s) -> 0 <= a <= h ->
  b <= s + h \/ (exists m, s + a <= complete ex m <= s + h /\ complete ex m <= b /\
    (forall n, (m <= n)%nat -> counts ex n /\ s <= sc_seen n) /\
    forall t, sc_out ex m <= t < b -> ~ ac_mode ex t) ->
  good near a h N_T (safe_with m) -> (forall t, s <= t <= b -> safe_with m (x ex t)) /\
  (s + h + INR N_T * delta T + window T <= b ->
    exists t, s + a <= t <= s + h + INR N_T * delta T + window T /\ Q (x ex t)).
Proof. intros near s a h b m Sb Nr Ah Cases G.
  destruct (is_fall_back near s a h b Sb Nr ltac:(lra) Cases) as (act & al & o & t0 & F).
  pose proof (window_pos T TH) as Wp.
  destruct (good_stays P answers (delta T) (window T) (state_age T) ltac:(lra) ltac:(lra) Q M shown near a h N_T
    (safe_with m) ltac:(lra) (safe_shown m) rest G _ _ _ _ _ _ _ F) as [In Rest]. split.
  - intros t Ht. replace t with (t - s + s) by lra. apply (In (t - s)). lra.
  - intros L. assert (Or : forall N, t0 + INR N * delta T <= al N <= t0 + INR N * delta T + window T /\ al 0%nat <= al N)
      by (intros N; eapply fall_back_ordered; [lra | exact F]).
    pose proof (fb_begins _ _ _ _ _ _ _ _ _ _ _ _ _ _ _ F) as Bg. destruct (Or 0%nat) as [O0 _]. simpl in O0.
    destruct Rest as (N & HN & _ & Qn & _); [destruct (Or N_T); lra |]. exists (al N + s). split; auto.
    destruct (Or N) as [ON O1]. apply le_INR in HN. pose proof (periods T TH). nra.
Qed.

(* The lemma: from a verdict "AC" until b, before which no other one is in force. *)
Lemma takes_over : forall n b, says_ac ex n -> (forall k, (n < k)%nat -> dm_out ex k < b -> ~ says_ac ex k) ->
  dm_seen n + H < b -> exists m, dm_seen n + alpha <= complete ex m <= dm_seen n + H /\ complete ex m <= b /\
    (forall n', (m <= n')%nat -> counts ex n' /\ dm_seen n <= sc_seen n') /\
    forall t, sc_out ex m <= t < b -> ~ ac_mode ex t.
Proof. intros n b Ac No Hb. destruct (verdicts n Ac) as (S0 & S1 & _). pose proof (not_negative T TH) as NN.
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
  - intros n' Hn'. apply reads_go_on; auto. pose proof (Started n' Hn'). lra.
  - intros t Ht (k & Hk & Ack & Last). assert (S n <= k)%nat by (apply Last; lra). apply (No k); [lia | lra | auto].
Qed.

(* (a) A verdict "AC" on a state of time s with map m: until the next one is in force, or for ever, the state is in C_m. *)
Theorem verdict_safe : forall n b, says_ac ex n -> (forall k, (n < k)%nat -> dm_out ex k < b -> ~ says_ac ex k) ->
  forall t, dm_seen n <= t <= b -> safe_with (map_of n) (x ex t).
Proof. intros n b Ac No t Ht. destruct (verdicts n Ac) as (S0 & S1 & S2 & G). destruct alpha_in as [_ A].
  refine (proj1 (decided _ (dm_seen n) alpha H b (map_of n) _ S2 A _ G) t Ht); [lra |].
  destruct (Rle_or_lt b (dm_seen n + H)); [left; auto | right; apply takes_over; auto].
Qed.

(* If no other verdict "AC" comes for so long, SC brings it to rest. *)
Theorem verdict_rests : forall n, says_ac ex n -> let b := dm_seen n + H + INR N_T * delta T + window T in
  (forall k, (n < k)%nat -> dm_out ex k < b -> ~ says_ac ex k) -> exists t, dm_seen n <= t <= b /\ Q (x ex t).
Proof. intros n Ac b No. destruct (verdicts n Ac) as (S0 & S1 & S2 & G). destruct alpha_in as [_ A].
  pose proof (periods T TH). pose proof (window_pos T TH). pose proof (pos_INR N_T).
  destruct (decided (fun z => reads_as P z (estimate_of n)) (dm_seen n) alpha H b (map_of n) ltac:(unfold b; nra) S2 A) as [_ (t & Ht & Qt)];
    [| exact G | unfold b; lra | exists t; unfold b; split; auto; lra].
  destruct (Rle_or_lt b (dm_seen n + H)); [left; auto | right; apply takes_over; auto].
Qed.

(* The start: with no error, and until h_0 any command. SC's outputs from number m0 on count. *)
Variable m0 : nat. Variable q : R. Variable map_0 : map.
Hypothesis counts_from : forall m, (m0 <= m)%nat -> counts ex m.
Hypothesis q_last : forall k, dm_release T k <= sc_release T m0 -> dm_release T k <= q.
Notation h0 := (h_0 T (sc_release T m0) q).
Definition alpha_0 := Rmax 0 (h0 - delta T - window T).
Hypothesis start : good (eq (x ex 0)) alpha_0 h0 N_T (safe_with map_0).
Theorem start_safe : forall b, (forall k, dm_out ex k < b -> ~ says_ac ex k) ->
  forall t, 0 <= t <= b -> safe_with map_0 (x ex t).
Proof. intros b No t Ht. pose proof (first_in_time P T answers ex TH m0 q q_last) as First.
  pose proof (sc_window P T answers ex TH m0). pose proof (not_negative T TH). pose proof (periods T TH).
  pose proof (window_pos T TH). assert (A : 0 <= alpha_0 <= h0) by (unfold alpha_0, Rmax; destruct Rle_dec; lra).
  refine (proj1 (decided (eq (x ex 0)) 0 alpha_0 h0 b map_0 _ eq_refl A _ start) t Ht); [lra |].
  destruct (Rle_or_lt b (0 + h0)) as [L | L]; [left; auto | right].
  destruct (last_complete h0 m0 First) as (m & Mm & Me). exists m. pose proof (sc_window P T answers ex TH m) as Wm.
  repeat split; try lra.
  - unfold alpha_0, Rmax. destruct Rle_dec; lra.
  - apply counts_from. lia.
  - apply sc_reads, counts_from. lia.
  - intros t' Ht' (k & Hk & Ack & _). apply (No k); auto. lra.
Qed.

(* (b) What is safe for ever: every map that was read shows less. *)
Variable C : state P -> Prop.
Hypothesis map_0_true : forall z, safe_with map_0 z -> C z.
Hypothesis maps_true : forall k, says_ac ex k -> forall z, safe_with (map_of k) z -> C z.
Theorem implicit_safe : forall t, 0 <= t -> C (x ex t).
Proof. intros t T0. destruct (verdicts_go_on P T answers ex TH t) as [n Hn].
  destruct (classic (exists k, (k < n)%nat /\ (dm_out ex k < t /\ says_ac ex k))) as [Some | None].
  - destruct (last_below (fun k => dm_out ex k < t /\ says_ac ex k) n Some) as (k & Kn & [Kt Ack] & Last).
    apply (maps_true k Ack), (verdict_safe k t Ack).
    + intros k' Hk' Ht Ac. apply (Last k'); auto. split; auto. destruct (Nat.le_gt_cases n k') as [L |]; auto.
      apply (dm_out_order P T answers ex TH) in L. lra.
    + destruct (verdicts k Ack) as (_ & S1 & _). pose proof (dm_answers ex k). lra.
  - apply map_0_true, (start_safe t); [| lra]. intros k Kt Ack. apply None. exists k. split; auto.
    destruct (Nat.le_gt_cases n k) as [L |]; auto. apply (dm_out_order P T answers ex TH) in L. lra.
Qed.
End Decided.
