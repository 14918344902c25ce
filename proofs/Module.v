(* One module: DM, AC and SC with their times, what reaches the plant, and the theorem.
   Purpose: "The model of time" and "Theorem" of docs/proof.md, for a module without nodes on its ways.
   Non-goals: the gate that looks at commands (Gate.v), return (Return.v), leases, views. *)
Require Import Reals Lra Lia Classical.
From Soter Require Import Releases Trajectories ScRuns.
Open Scope R_scope.
Record times := {
  Delta : R; delta : R; dm_phase : R; sc_phase : R;       (* periods and phases of DM and SC *)
  dm_late : R; dm_response : R; sc_late : R; sc_response : R;
  L : R; L_min : R;                                       (* from an output to its effect *)
  age : R; sc_age : R;                                    (* of the states that DM and SC read, at their start *)
  G : R; r : R }.                                         (* from a release of the DM to one of SC: at most, at least *)

Section Times.
Variable T : times.
Definition dm_release k := dm_phase T + INR k * Delta T.
Definition sc_release m := sc_phase T + INR m * delta T.
Definition Lambda := Rmax (sc_late T) (dm_late T + dm_response T - r T).
Definition window := Lambda + sc_response T + L T - L_min T.
Definition state_age := sc_age T + sc_response T + L T.
Definition H_star := age T + Delta T + Rmax (dm_late T + dm_response T) (G T + sc_late T) + sc_response T + L T.
(* rho the release of SC from which on outputs count, q no earlier than the DM's last one at or before rho *)
Definition h_0 rho q := rho + Rmax (sc_late T) (q + dm_late T + dm_response T - rho) + sc_response T + L T.
Record times_hold : Prop := {
  periods : 0 < delta T <= Delta T;
  not_negative : 0 <= dm_phase T < Delta T /\ 0 <= sc_phase T /\ 0 <= dm_late T /\ 0 <= dm_response T /\ 0 <= sc_late T /\
    0 <= sc_response T /\ 0 <= L_min T <= L T /\ 0 <= age T /\ 0 <= sc_age T;
  no_overlap : dm_late T + dm_response T <= Delta T;
  windows_apart : 2 * window <= delta T;                  (* R015 *)
  G_most : forall k, exists m, dm_release (S k) <= sc_release m <= dm_release (S k) + G T;
  G_less : G T < Delta T;
  r_least : forall k m, dm_release k <= sc_release m -> dm_release k + r T <= sc_release m }.
End Times.

(* One execution. A verdict is in force from dm_out on; the mode at an instant is that of the last one in force. *)
Record execution {P : plant} {T : times} {answers : estimate P -> (component P -> value P) -> Prop} := {
  x : R -> state P; u : R -> component P -> value P;
  dm_start : nat -> R; dm_out : nat -> R; says_ac : nat -> Prop;
  sc_start : nat -> R; sc_out : nat -> R; counts : nat -> Prop; out : nat -> component P -> value P;
  acts : nat -> component P -> R; complete : nat -> R;
  emitted : component P -> R -> R -> value P -> Prop;  (* emitted i e a v: v is published at e and begins to act at a *)
  ac_mode := fun t => exists k, dm_out k <= t /\ says_ac k /\ forall k', dm_out k' <= t -> (k' <= k)%nat;
  dm_starts : forall k, dm_release T k <= dm_start k <= dm_release T k + dm_late T;
  dm_answers : forall k, dm_start k <= dm_out k <= dm_start k + dm_response T;
  sc_waits : forall k m, dm_release T k <= sc_release T m -> dm_out k <= sc_start m;
  sc_starts : forall m, sc_release T m <= sc_start m /\ (sc_start m <= sc_release T m + sc_late T \/
    exists k, dm_release T k <= sc_release T m /\ sc_start m <= dm_out k);
  sc_publishes : forall m, sc_start m <= sc_out m <= sc_start m + sc_response T;
  sc_acts : forall m i, sc_out m + L_min T <= acts m i <= sc_out m + L T;
  sc_complete : forall m, (forall i, acts m i <= complete m) /\ exists i, acts m i = complete m;
  sc_answers : forall m, counts m -> exists y, answers y (out m) /\ forall p, exists s,
    0 <= s /\ sc_start m - sc_age T <= s <= sc_start m /\ shows P p (x s) y;
  (* the gate: SC's outputs pass unless AC has control, and then nothing else does; all that passes is in U *)
  sc_passes : forall m i, ~ ac_mode (sc_out m) -> emitted i (sc_out m) (acts m i) (out m i);
  sc_alone : forall i e a v, emitted i e a v -> 0 <= e -> ~ ac_mode e ->
    exists m, e = sc_out m /\ a = acts m i /\ v = out m i;
  emitted_in_U : forall i e a v, emitted i e a v -> e <= a <= e + L T /\ inputs P i v;
  (* the actuators: of what acts at t the last that was emitted; effects come in order *)
  acting : forall t i, 0 <= t -> exists e a, emitted i e a (u t i) /\ a <= t /\
    forall e' a' v', emitted i e' a' v' -> a' <= t -> e' <= e;
  moves : forall t, 0 <= t -> flow P x u 0 t }.

Section Safety.
Variable P : plant. Variable T : times.
Variable answers : estimate P -> (component P -> value P) -> Prop.
Variable ex : @execution P T answers. Hypothesis TH : times_hold T.
Notation x := (x ex). Notation u := (u ex). Notation dm_start := (dm_start ex). Notation dm_out := (dm_out ex).
Notation says_ac := (says_ac ex). Notation sc_start := (sc_start ex). Notation sc_out := (sc_out ex).
Notation acts := (acts ex). Notation complete := (complete ex). Notation counts := (counts ex).
Notation out := (out ex). Notation ac_mode := (ac_mode ex). Notation emitted := (emitted ex).
Notation run m b := (fun C => sc_run P answers (delta T) (window T) (state_age T) C x u (fun k => acts (m + k)%nat)
  (fun k => complete (m + k)%nat) (fun k => out (m + k)%nat) (sc_release T m + L_min T) b).

Lemma dm_window : forall k, dm_release T k <= dm_start k /\ dm_start k <= dm_out k /\
  dm_out k <= dm_release T k + dm_late T + dm_response T /\ dm_out k <= dm_release T (S k) /\ 0 <= dm_release T k.
Proof. intros k. pose proof (dm_starts ex k). pose proof (dm_answers ex k). pose proof (no_overlap T TH).
  pose proof (not_negative T TH). pose proof (periods T TH). pose proof (pos_INR k).
  unfold dm_release in *. rewrite S_INR. nra.
Qed.

Lemma dm_out_order : forall k n, (k <= n)%nat -> dm_out k <= dm_out n.
Proof.
  intros k n Q. induction Q as [| n _ IH]; [lra |]. destruct (dm_window n) as (_ & _ & _ & W & _).
  destruct (dm_window (S n)). lra.
Qed.

Lemma sc_window : forall m, 0 <= sc_release T m <= sc_start m /\ sc_start m <= sc_out m /\
  sc_out m <= sc_release T m + Lambda T + sc_response T /\ sc_out m + L_min T <= complete m <= sc_out m + L T.
Proof.
  intros m. destruct (sc_starts ex m) as [S1 S2]. pose proof (sc_publishes ex m). pose proof (not_negative T TH).
  pose proof (periods T TH). pose proof (pos_INR m). assert (0 <= sc_release T m) by (unfold sc_release; nra).
  destruct (sc_complete ex m) as [_ [i <-]]. pose proof (sc_acts ex m i). repeat split; try lra. unfold Lambda.
  pose proof (Rmax_l (sc_late T) (dm_late T + dm_response T - r T)).
  pose proof (Rmax_r (sc_late T) (dm_late T + dm_response T - r T)). destruct S2 as [S2 | [k [R1 S2]]]; [lra |].
  pose proof (r_least T TH k m R1). destruct (dm_window k) as (_ & _ & W & _). lra.
Qed.

Lemma window_pos : 0 <= window T /\ window T < delta T /\ Lambda T + sc_response T <= window T.
Proof. pose proof (not_negative T TH). pose proof (periods T TH). pose proof (windows_apart T TH).
  pose proof (Rmax_l (sc_late T) (dm_late T + dm_response T - r T)). unfold window, Lambda in *. lra.
Qed.

Lemma sc_in_order : forall m n i, (m < n)%nat -> sc_out m < sc_out n /\ acts m i < acts n i.
Proof. intros m n i Hmn. pose proof (sc_window m). pose proof (sc_window n). pose proof (sc_acts ex m i).
  pose proof (sc_acts ex n i). assert (INR m + 1 <= INR n) by (rewrite <- S_INR; apply le_INR; lia).
  pose proof window_pos. pose proof (periods T TH). unfold window, sc_release in *. nra.
Qed.

Lemma sc_out_order : forall m n, (m <= n)%nat -> sc_out m <= sc_out n.
Proof. intros m n Q. destruct (sc_complete ex m) as [_ [i _]]. destruct (Nat.eq_dec m n) as [-> | Ne]; [lra |].
  left. apply (sc_in_order m n i). lia.
Qed.

Lemma complete_by : forall m b, (forall k, dm_release T k <= sc_release T m -> dm_out k <= b) ->
  complete m <= Rmax (sc_release T m + sc_late T) b + sc_response T + L T.
Proof.
  intros m b Hb. destruct (sc_starts ex m) as [_ SS]. pose proof (sc_publishes ex m). pose proof (sc_window m).
  pose proof (Rmax_l (sc_release T m + sc_late T) b). pose proof (Rmax_r (sc_release T m + sc_late T) b).
  destruct SS as [SS | [k [Rk SS]]]; [lra |]. specialize (Hb k Rk). lra.
Qed.

Lemma U_only : forall a b, 0 <= a -> within P (inputs P) u a b.
Proof.
  intros a b Ha t i Ht. destruct (acting ex t i ltac:(lra)) as (e & e' & E & _). apply (emitted_in_U ex _ _ _ _ E).
Qed.

Lemma moves_from : forall a b, 0 <= a <= b -> flow P x u a b.
Proof. intros a b Q. apply flow_part with 0 b; try lra. apply moves. lra. Qed.

(* From an output that counts on, while no "AC" verdict is in force, the execution is an SC-run. *)
Lemma sc_run_begins : forall (C : state P -> Prop) m b,
  (forall n, (m <= n)%nat -> sc_out n < b -> counts n) -> complete m <= b ->
  (forall t, 0 <= t <= complete m -> C (x t)) -> (forall t, sc_out m <= t < b -> ~ ac_mode t) -> run m b C.
Proof. intros C m b Hc Hb HC Hm. pose proof (sc_window m) as W. pose proof (not_negative T TH) as NN.
  assert (Rel : forall k, sc_release T (m + k) = sc_release T m + INR k * delta T)
    by (intros; unfold sc_release; rewrite plus_INR; ring).
  constructor.
  - intros k i. pose proof (sc_window (m + k)) as Q. pose proof (sc_acts ex (m + k) i).
    rewrite Rel in Q. unfold window. lra.
  - intros k. apply sc_complete.
  - rewrite Nat.add_0_r. lra.
  - rewrite Nat.add_0_r. intros t T0 Ht. apply HC. lra.
  - apply U_only. lra.
  - intros k i t Ht Hb'. destruct (acting ex t i ltac:(lra)) as (e & a & E & Ha & Last).
    pose proof (sc_out_order m (m + k) ltac:(lia)). pose proof (sc_acts ex (m + k)%nat i) as Acts.
    pose proof (Last _ _ _ (sc_passes ex (m + k)%nat i ltac:(apply Hm; lra)) ltac:(lra)) as Le.
    destruct (emitted_in_U ex _ _ _ _ E) as [Ea _].
    destruct (sc_alone ex _ _ _ _ E) as (n & -> & -> & ->); [lra | apply Hm; lra |].
    destruct (Nat.lt_trichotomy n (m + k)) as [Q | [-> | Q]]; auto; exfalso.
    + apply (sc_in_order n (m + k) i) in Q. lra.
    + assert (acts (m + S k)%nat i <= acts n i); [| lra]. destruct (Nat.eq_dec n (m + S k)) as [-> |]; [lra |].
      left. apply (sc_in_order (m + S k) n i). lia.
  - intros k [i0 Hi0]. pose proof (sc_acts ex (m + k)%nat i0).
    destruct (sc_answers ex (m + k)%nat) as (y & Ans & Rd); [apply Hc; [lia | lra] |].
    exists y. split; auto. intros p. destruct (Rd p) as (s & S0 & S1 & S2).
    exists s. pose proof (sc_window (m + k)). pose proof (sc_publishes ex (m + k)).
    unfold state_age. repeat split; auto; [lra |]. intros i. pose proof (sc_acts ex (m + k) i). lra.
  - apply moves. lra.
Qed.

(* Where no verdict from number j on is "AC" until that of n, nobody but SC gets through. *)
Lemma no_ac : forall j n t, (forall k, (j <= k < n)%nat -> ~ says_ac k) -> j = 0%nat \/ dm_out j <= t ->
  t < dm_out n -> ~ ac_mode t.
Proof. intros j n t No Hj Ht (k & Hk & Ac & Last). apply (No k); auto. split.
  - destruct Hj as [-> | Hj]; [lia | apply Last; exact Hj].
  - destruct (Nat.lt_ge_cases k n) as [| Q]; auto. apply dm_out_order in Q. lra.
Qed.

Lemma verdicts_go_on : forall t, exists n, t <= dm_out n.
Proof. intros t. pose proof (periods T TH). destruct (enough_steps (t - dm_phase T) (Delta T)) as [n Hn]; [lra |].
  exists n. destruct (dm_window n) as (W & W' & _). unfold dm_release in W. lra.
Qed.

(* P1c. After a release j of the DM: an output of SC that starts after the verdict of j + 1 and is complete in time. *)
Lemma takes_over_in_time : forall j, exists m, dm_release T (S j) <= sc_release T m /\
  dm_out (S j) <= sc_start m /\ complete m <= dm_release T j - age T + H_star T.
Proof.
  intros j. destruct (G_most T TH j) as [m [M1 M2]]. exists m. repeat split; auto; [apply (sc_waits ex); exact M1 |].
  pose proof (complete_by m (dm_release T (S j) + (dm_late T + dm_response T))) as Q. unfold H_star.
  assert (Rel : dm_release T (S j) = dm_release T j + Delta T) by (unfold dm_release; rewrite S_INR; ring).
  pose proof (Rmax_l (dm_late T + dm_response T) (G T + sc_late T)).
  pose proof (Rmax_r (dm_late T + dm_response T) (G T + sc_late T)). pose proof (G_less T TH).
  refine (Rle_trans _ _ _ (Q _) _); [| unfold Rmax at 1; destruct Rle_dec; lra].
  intros k Rk. assert (Kj : (k <= S j)%nat).
  { destruct (Nat.le_gt_cases k (S j)) as [| Gt]; auto. apply le_INR in Gt. rewrite S_INR in Gt.
    pose proof (periods T TH). unfold dm_release in *. nra. }
  apply dm_out_order in Kj. destruct (dm_window (S j)) as (_ & _ & W & _). lra.
Qed.

(* SC's outputs from number m0 on count, whatever happened before. *)
Variable m0 : nat. Variable q : R.
Hypothesis counts_from : forall m, (m0 <= m)%nat -> counts m.
Hypothesis q_last : forall k, dm_release T k <= sc_release T m0 -> dm_release T k <= q.
Notation h0 := (h_0 T (sc_release T m0) q).
Lemma first_in_time : complete m0 <= h0.
Proof. refine (Rle_trans _ _ _ (complete_by m0 (q + dm_late T + dm_response T) _) _).
  - intros k Rk. destruct (dm_window k) as (_ & _ & W & _). pose proof (q_last k Rk). lra.
  - unfold h_0, Rmax. repeat destruct Rle_dec; lra.
Qed.

Variables C K : state P -> Prop.
Hypothesis K_in_C : forall z, K z -> C z.
Hypothesis P2a : core P answers (delta T) (window T) (state_age T) C K.

(* The invariant: (F) free until a deadline, or (S) an SC-run from K. *)
Definition free t := exists D, t <= D /\ look_ahead P K (D - t) (x t).
Definition under_sc t := exists m, K (x (complete m)) /\ complete m <= t /\ run m t C.
Lemma free_along : forall s h t, 0 <= s -> s <= t <= s + h -> look_ahead P K h (x s) -> free t.
Proof. intros s h t S0 St HR. exists (s + h). split; [lra |].
  apply look_ahead_later with u; auto; [apply U_only | apply moves_from]; lra.
Qed.

Lemma free_K : forall t, 0 <= t -> free t -> K (x t).
Proof.
  intros t T0 (D & HD & HR). apply (look_along P K (D - t) x u t t); auto; try lra;
    [apply U_only | apply moves_from]; lra.
Qed.

Lemma invariant_C : forall t, 0 <= t -> free t \/ under_sc t -> C (x t).
Proof. intros t T0 [F | (m & Km & Hm & Run)]; [apply K_in_C, free_K; auto |].
  apply (P2a _ _ _ _ _ _ _ Run); rewrite ?Nat.add_0_r; auto; lra.
Qed.

(* From a state of time s with H to go, if SC is complete at m before that and alone from then on until b. *)
Lemma segment : forall s h m b, 0 <= s -> look_ahead P K h (x s) -> s <= complete m <= s + h ->
  (forall t, 0 <= t < s -> C (x t)) -> (forall n, (m <= n)%nat -> counts n) ->
  (forall t, sc_out m <= t < b -> ~ ac_mode t) -> forall t, s <= t <= b -> free t \/ under_sc t.
Proof. intros s h m b S0 HR Sm HC Hc Hm t Ht. destruct (Rle_or_lt t (complete m)) as [Q | Q].
  - left. apply free_along with s h; auto; lra.
  - right. exists m. split; [| split; [lra |]].
    + apply free_K; [lra |]. apply free_along with s h; auto; lra.
    + apply sc_run_begins; auto; [lra | | intros t' Ht'; apply Hm; lra].
      intros t' Ht'. destruct (Rlt_or_le t' s); [apply HC; lra |]. apply K_in_C, free_K; [lra |].
      apply free_along with s h; auto; lra.
Qed.

Hypothesis start : look_ahead P K h0 (x 0).
Lemma invariant_at_first : forall n t, (forall k, (k < n)%nat -> ~ says_ac k) -> 0 <= t <= dm_out n ->
  free t \/ under_sc t.
Proof. intros n t No Ht. pose proof first_in_time. pose proof (sc_window m0). pose proof (not_negative T TH).
  apply segment with 0 h0 m0 (dm_out n); auto; try lra; [intros; lra |].
  intros t' Ht'. apply no_ac with 0%nat n; [intros k Kn; apply No; lia | auto | lra].
Qed.

Variable H : R.
Variables ttf safer : estimate P -> Prop.
(* A verdict "AC" is on a read of a state no older than the age, at which ttf is false (or safer true). *)
Hypothesis verdicts : forall k, says_ac k -> exists s y, 0 <= s /\ dm_start k - age T <= s <= dm_start k /\
  reads_as P (x s) y /\ (~ ttf y \/ safer y).
Hypothesis P3 : forall z y, C z -> reads_as P z y -> ~ ttf y \/ safer y -> look_ahead P K H z.
Hypothesis P1c : H_star T <= H.
(* SC reads no more than the DM, whose read was available; or there is time for the first output that counts. *)
Hypothesis available : (forall k m, says_ac k -> dm_start k <= sc_start m -> counts m) \/ h0 <= H.
Lemma invariant_until : forall n t, 0 <= t <= dm_out n -> free t \/ under_sc t.
Proof. induction n as [n IH] using (well_founded_induction lt_wf). intros t Ht.
  destruct (classic (exists k, (k < n)%nat /\ says_ac k)) as [Some | None].
  - destruct (last_below says_ac n Some) as (j & Jn & Acj & NoAc).
    destruct (verdicts j Acj) as (s & y & S0 & S1 & S2 & S3). destruct (dm_window j) as (D1 & D2 & D3 & D4 & D5).
    destruct (Rlt_or_le t s) as [Q | Q]; [apply (IH j); auto; lra |].
    assert (HC : forall t', 0 <= t' <= s -> C (x t'))
      by (intros t' Ht'; apply invariant_C; [lra | apply (IH j); auto; lra]).
    assert (HR : look_ahead P K H (x s)) by (apply P3 with y; auto; apply HC; lra).
    destruct (takes_over_in_time j) as (m & M1 & M2 & M3).
    assert (exists m', (forall n', (m' <= n')%nat -> counts n') /\ dm_out (S j) <= sc_out m' /\
      s <= complete m' <= s + H) as (m' & Cm & Om & Mm).
    { pose proof (sc_window m). pose proof (sc_publishes ex m). pose proof (dm_window (S j)). pose proof (not_negative T TH).
      destruct available as [Av | Av]; [| destruct (Nat.le_ge_cases m0 m) as [Q' | Q']].
      - exists m. repeat split; try lra. intros n' N'. apply (Av j); auto. assert (dm_out (S j) <= sc_start n'); [| lra].
        apply (sc_waits ex). apply le_INR in N'. pose proof (periods T TH). unfold sc_release in *. nra.
      - exists m. repeat split; try lra. intros n' N'. apply counts_from. lia.
      - exists m0. pose proof first_in_time. pose proof (sc_out_order m m0 Q'). pose proof (sc_window m0).
        repeat split; auto; lra. }
    apply segment with s H m' (dm_out n); auto; [| | lra].
    + intros t' Ht'. apply HC; lra.
    + intros t' Ht'. apply no_ac with (S j) n; [intros k Kn; apply NoAc; lia | right | ]; lra.
  - apply invariant_at_first with n; auto. intros k Kn Ak. apply None. eauto.
Qed.

Theorem invariant : forall t, 0 <= t -> free t \/ under_sc t.
Proof. intros t T0. destruct (verdicts_go_on t) as [n Hn]. apply (invariant_until n). lra. Qed.
Theorem safe : forall t, 0 <= t -> C (x t).
Proof. intros t T0. apply invariant_C, invariant; exact T0. Qed.
End Safety.
