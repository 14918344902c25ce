(* An integrator x' = u + w, |u| <= 1, |w| <= 1/10, of which every hypothesis of the theorems is proved, in an execution
   with a takeover and a return. All latenesses, responses, ages and errors are positive, and at their bounds.
   Purpose: what is assumed in Module.v, Return.v, Gate.v and Implicit.v can be met. Times in units of 50 ms.
   Non-goals: anything about integrators. *)
Require Import Reals Lra Lia Classical Arith.
From Soter Require Import Releases Trajectories ScRuns Module Return Gate Implicit.
Open Scope R_scope.

(* What every solution obeys; all that is said of the plant. *)
Definition rate (x : R -> R) (u : R -> unit -> R) a b := forall s t lo hi, a <= s <= t -> t <= b ->
  (forall r, s <= r < t -> lo <= u r tt <= hi) -> (lo - 1/10) * (t - s) <= x t - x s <= (hi + 1/10) * (t - s).

Definition integrator : plant.
Proof. refine {| state := R; component := unit; value := R; estimate := R; topic := unit; flow := rate;
    inputs := fun _ v => -1 <= v <= 1; shows := fun _ z y => -2 <= y - z <= 2 |}; unfold rate.
  - intros x y u v a b Ex Eu F s t lo hi S1 S2 Hu. rewrite <- !Ex by lra. apply F; auto.
    intros r Hr. rewrite Eu by lra. auto.
  - intros x u a b d F s t lo hi S1 S2 Hu. replace (t - s) with (t + d - (s + d)) by lra. apply F; try lra.
    intros r Hr. replace r with (r - d + d) by lra. apply Hu. lra.
  - intros x u a b c d Q1 Q2 F s t lo hi S1 S2 Hu. apply F; auto; lra.
  - intros x u a b c Q F G s t lo hi S1 S2 Hu. destruct (Rle_or_lt t b); [apply F; auto |].
    destruct (Rle_or_lt b s); [apply G; auto; lra |].
    assert (A := F s b lo hi ltac:(lra) ltac:(lra) ltac:(intros; apply Hu; lra)).
    assert (B := G b t lo hi ltac:(lra) ltac:(lra) ltac:(intros; apply Hu; lra)). nra.
Defined.

Definition T := {| Delta := 20; delta := 20; dm_phase := 0; sc_phase := 5; dm_late := 1; dm_response := 1;
  sc_late := 1; sc_response := 1; L := 2; L_min := 0; age := 2; sc_age := 2; G := 5; r := 5 |}.

Definition law (y : R) : R := if Rlt_dec 40 y then -1 else if Rlt_dec y (-40) then 1 else 0.
Definition answers (y : estimate integrator) (v : component integrator -> value integrator) : Prop := v tt = law y.
Definition ball (d z : R) := -d <= z <= d.
Ltac times := unfold window, Lambda, state_age, H_star, h_0, sc_release, dm_release in *; simpl in *;
  unfold Rmax in *; repeat destruct Rle_dec; try lra.

Lemma T_window : window T = 4. Proof. times. Qed. Lemma T_age : state_age T = 5. Proof. times. Qed.
Lemma T_H : H_star T = 31. Proof. times. Qed.

Lemma nat_apart : forall k m, (INR k <= INR m /\ (k <= m)%nat) \/ (INR m + 1 <= INR k /\ (m < k)%nat).
Proof. intros k m. destruct (Nat.le_gt_cases k m); [left | right]; split; auto;
  [apply le_INR | rewrite <- S_INR; apply le_INR]; lia. Qed.
Lemma T_holds : times_hold T.
Proof. constructor; try (times; fail).
  - intros k. exists (S k). times.
  - intros k m. destruct (nat_apart k m) as [[Q _] | [Q _]]; times.
Qed.

(* The gate permits more than the DM: at 190 not every command may act for H, but braking may. *)
Theorem gate_permits_more : gated_look_ahead integrator (ball 200) (fun _ v => v = -1) 31 2 190 /\
  ~ look_ahead integrator (ball 200) 31 190.
Proof. split.
  - intros x u t1 t2 T1 T2 T3 E HV HU F t Ht. destruct (Rle_or_lt t t1) as [Q | Q].
    + destruct (F 0 t (-1) (-1) ltac:(lra) ltac:(lra)); [intros q Hq; rewrite (HV q tt) by lra; lra |]. unfold ball. lra.
    + destruct (F 0 t1 (-1) (-1) ltac:(lra) ltac:(lra)); [intros q Hq; rewrite (HV q tt) by lra; lra |].
      destruct (F t1 t (-1) 1 ltac:(lra) ltac:(lra)); [intros q Hq; apply (HU q tt); lra |]. unfold ball. lra.
  - intros Q. specialize (Q (fun t => 190 + t) (fun _ _ => 1) 31 ltac:(lra) ltac:(lra)).
    assert (A : ball 200 (190 + 31)); [apply Q | unfold ball in A]; try lra; [intros t i Ht; simpl; lra |].
    intros s t lo hi S1 S2 Hu. destruct (Req_dec s t) as [-> | Ne]; [lra |]. specialize (Hu s ltac:(lra)). nra.
Qed.

(* Over a time h the state moves by 11/10 h at most. *)
Lemma moves_by : forall x u a b s t, flow integrator x u a b -> within integrator (inputs integrator) u a b ->
  a <= s <= t -> t <= b -> ball (11/10 * (t - s)) (x t - x s).
Proof. intros x u a b s t F U S1 S2. destruct (F s t (-1) 1 S1 S2) as [A B]; [| unfold ball; lra].
  intros q Hq. apply (U q tt). lra.
Qed.

Lemma look : forall d h z, ball (d - 11/10 * h) z -> look_ahead integrator (ball d) h z.
Proof. intros d h z Hz x u b Hb E U F t Ht. pose proof (moves_by x u 0 b 0 t F U ltac:(lra) ltac:(lra)) as M.
  unfold ball in *. rewrite E in M. lra.
Qed.

Notation run C := (sc_run integrator answers 20 4 5 C).

(* One period of SC: from d, at least 80, it stays in d; and comes nearer, to 80. *)
Lemma one_period : forall C x u act al out t0 b d, run C x u act al out t0 b -> 80 <= d -> ball d (x (al 0%nat)) ->
  (forall t, al 0%nat <= t <= Rmin b (al 1%nat) -> ball d (x t)) /\
  (al 1%nat <= b -> ball (Rmax 80 (d - 14)) (x (al 1%nat))).
Proof. intros C x u act al out t0 b d H Hd H0.
  pose proof (last_window integrator answers 20 4 5 C x u act al out t0 b 0 H) as W0.
  pose proof (last_window integrator answers 20 4 5 C x u act al out t0 b 1 H) as W1. simpl in W0, W1.
  destruct H as [_ M B _ U Cm Rd F]. destruct (M 0%nat) as [_ [[] M0]]. destruct (M 1%nat) as [_ [[] M1]].
  assert (Q : forall t, al 0%nat <= t <= Rmin b (al 1%nat) -> ball d (x t) /\
    (al 0%nat + 16 <= t -> ball (Rmax 80 (d - 14)) (x t))).
  { intros t Ht. assert (Tb : t <= b /\ t <= al 1%nat) by (unfold Rmin in Ht; destruct Rle_dec; lra).
    destruct (Req_dec t (al 0%nat)) as [-> | Ne]; [split; auto; lra |].
    destruct (Rd 0%nat) as (y & S4 & Rp); [exists tt; lra |]. destruct (Rp tt) as (s & S0 & S1 & S2 & S3).
    specialize (S2 tt).
    assert (Rate := F (al 0%nat) t (law y) (law y) ltac:(lra) ltac:(lra)).
    assert (Back := moves_by x u 0 b s (al 0%nat) F U ltac:(lra) ltac:(lra)).
    destruct Rate as [R1 R2]; [intros q Hq; rewrite (Cm 0%nat tt q), S4 by lra; lra |].
    unfold ball in *. simpl in *. pose proof (Rmax_l 80 (d - 14)). pose proof (Rmax_r 80 (d - 14)).
    unfold law in *. destruct (Rlt_dec 40 y); [| destruct (Rlt_dec y (-40))]; lra. }
  split; [intros t Ht; apply Q; auto |]. intros L. apply Q; [unfold Rmin; destruct Rle_dec |]; lra.
Qed.

Lemma kept : forall (C : R -> Prop) d (S : R -> Prop), 80 <= d -> (forall z, ball d z -> S z) -> (forall z, S z -> C z) ->
  keeps integrator answers 20 4 5 C (ball d) S.
Proof. intros C d S Hd HS HC. apply keeps_of_chains; try lra; auto. intros z Hz. exists 1%nat. split; [lia |].
  intros x u act al out t0 b Hrun E. rewrite <- E in Hz. destruct (one_period _ _ _ _ _ _ _ _ d Hrun Hd Hz) as [A B].
  split; [intros t Ht; auto |]. intros L. specialize (B L). unfold ball, Rmax in *. destruct Rle_dec; lra.
Qed.

Lemma comes_home : forall (C : R -> Prop) n z, ball (80 + INR n * 14) z ->
  leads_to integrator answers 20 4 5 C (ball 80) (INR n * 20) z.
Proof. induction n; intros z Hz; [apply arrived; simpl in *; [lra | unfold ball in *; lra] |].
  rewrite S_INR in *. pose proof (pos_INR n). replace ((INR n + 1) * 20) with (INR n * 20 + INR 1 * 20) by (simpl; ring).
  apply chain_to; [lra |]. intros x u act al out t0 b Hrun E L. apply IHn. rewrite <- E in Hz.
  destruct (one_period _ _ _ _ _ _ _ _ (80 + (INR n + 1) * 14) Hrun ltac:(lra) Hz) as [_ B]. specialize (B L).
  unfold ball, Rmax in *. destruct Rle_dec; lra.
Qed.

(* The execution: AC pushes, with the wind, until the DM finds ttf at its step 9; SC brings it back until step 14. *)
Definition X (t : R) : R := if Rlt_dec t 29 then 0 else if Rlt_dec t 189 then 11/10 * (t - 29) else
  if Rlt_dec t 289 then 176 - (t - 189) else 76.
Definition commands (t : R) : R := if Rlt_dec t 29 then 0 else if Rlt_dec t 189 then 1 else
  if Rlt_dec t 289 then -1 else 0.
Definition command m := commands (20 * INR m + 9).
Definition ac k := (1 <= k <= 8)%nat \/ (14 <= k)%nat.
Definition published (_ : unit) e a v := (e = -1 /\ a = -1 /\ v = 0) \/
  exists m, e = 20 * INR m + 7 /\ a = 20 * INR m + 9 /\ v = command m.
Definition sc_says m := law (X (20 * INR m + 4) + 2).
Ltac cases := unfold sc_says, law, command, commands, X in *; repeat (match goal with
  | |- context [Rlt_dec ?a ?b] => destruct (Rlt_dec a b)
  | Q : context [Rlt_dec ?a ?b] |- _ => destruct (Rlt_dec a b) end; try lra); try lra.
Ltac naturals := repeat match goal with
  | Q : (?a <= ?b)%nat |- _ => apply le_INR in Q; simpl in Q
  | Q : (?a < ?b)%nat |- _ => apply le_INR in Q; rewrite S_INR in Q; simpl in Q end.

Lemma X_moves : forall t, 0 <= t -> rate X (fun t _ => commands t) 0 t.
Proof.
  assert (Piece : forall a b c e, a <= b -> c - 1/10 <= e <= c + 1/10 -> (forall t, a <= t < b -> commands t = c) ->
    (forall t, a <= t <= b -> X t = X a + e * (t - a)) -> rate X (fun t _ => commands t) a b).
  { intros a b c e Hab He Hc HX s t lo hi S1 S2 Hu. destruct (Req_dec s t) as [-> | Ne]; [lra |].
    specialize (Hu s ltac:(lra)). rewrite Hc in Hu by lra. rewrite (HX s), (HX t) by lra. nra. }
  intros t T0. apply (flow_part integrator X (fun t _ => commands t) 0 (t + 300)); try lra.
  apply (flow_joined integrator) with 29; [lra | apply Piece with 0 0 | apply (flow_joined integrator) with 189];
    [lra | lra | intros; cases | intros; cases | lra | apply Piece with 1 (11/10) | apply (flow_joined integrator) with 289];
    [lra | lra | intros; cases | intros; cases | lra | apply Piece with (-1) (-1) | apply Piece with 0 0];
    solve [lra | intros; cases].
Qed.

Lemma below : forall k m, 20 * INR k < 20 * INR m + 20 -> (k <= m)%nat /\ INR k <= INR m.
Proof. intros k m Q. destruct (nat_apart k m) as [[Q' K] | [Q' _]]; [auto | lra]. Qed.

(* Where AC has no control what acts is what SC says. *)
Lemma alone : forall m, ~ (exists k, 20 * INR k + 2 <= 20 * INR m + 7 /\ ac k /\
  forall k', 20 * INR k' + 2 <= 20 * INR m + 7 -> (k' <= k)%nat) -> command m = sc_says m.
Proof.
  intros m No. assert (Hm : ~ ac m) by (intros A; apply No; exists m; repeat split; auto; [lra |];
    intros k' Q; apply below; lra).
  assert (Q : (m <= 0)%nat \/ (9 <= m <= 13)%nat) by (unfold ac in Hm; lia).
  destruct Q as [Q | [Q1 Q2]]; naturals; pose proof (pos_INR m); cases.
Qed.

Definition flight : @execution integrator T answers.
Proof. refine {| x := (X : R -> state integrator); u := fun t _ => commands t; dm_start := fun k => 20 * INR k + 1;
    dm_out := fun k => 20 * INR k + 2; says_ac := ac; sc_start := fun m => 20 * INR m + 6;
    sc_out := fun m => 20 * INR m + 7; counts := fun _ => True; out := fun m _ => sc_says m;
    acts := fun m _ => 20 * INR m + 9; complete := fun m => 20 * INR m + 9; emitted := published |}.
  all: try (intros; times; fail).
  - intros k m Q. times. destruct (below k m); lra.
  - intros m. split; [intros _; apply Rle_refl | exists tt; reflexivity].
  - intros m _. exists (X (20 * INR m + 4) + 2). split; [reflexivity | intros p]. exists (20 * INR m + 4).
    pose proof (pos_INR m). simpl. repeat split; lra.
  - intros m i No. right. exists m. rewrite <- alone; auto.
  - intros i e a v [(-> & -> & ->) | (m & -> & -> & ->)] E0 No; [lra |]. exists m. rewrite alone; auto.
  - intros i e a v [(-> & -> & ->) | (m & -> & -> & ->)]; simpl; split; try lra; cases.
  - intros t i T0. destruct (Rlt_or_le t 9) as [Q | Q].
    + exists (-1), (-1). split; [left; repeat split; cases | split; [lra |]].
      intros e a v [(-> & _) | (m & -> & -> & _)] Ha; [lra | pose proof (pos_INR m); lra].
    + assert (Q1 : exists m, 20 * INR m + 9 <= t < 20 * INR m + 29).
      { destruct (next_release 9 20 t) as [m Hm]; try lra. destruct (Rle_or_lt (9 + INR m * 20) t); [exists m; lra |].
        destruct m; [simpl in *; lra |]. exists m. rewrite S_INR in *. lra. }
      destruct Q1 as [m Hm]. exists (20 * INR m + 7), (20 * INR m + 9). split; [right; exists m | split; [lra |]].
      * repeat split. pose proof (nat_apart m 0).
        pose proof (nat_apart m 8). pose proof (nat_apart m 13). simpl in *. cases.
      * intros e a v [(-> & _) | (k & -> & -> & _)] Ha; [pose proof (pos_INR m); lra |].
        destruct (below k m); lra.
  - exact X_moves.
Defined.

(* The DM reads as late as it may, as wrong as it may be, and goes by its predicates. *)
Definition seen k := X (20 * INR k - 1) + 2. Definition ttf y := ~ ball 160 y. Definition safer y := ball 100 y.
Theorem dm_goes_by_its_predicates : forall k, ((k = 1 \/ 14 <= k)%nat -> safer (seen k)) /\
  ((2 <= k <= 8)%nat -> ~ ttf (seen k)) /\ (k = 9%nat -> ttf (seen k)) /\ ((10 <= k <= 13)%nat -> ~ safer (seen k)).
Proof. intros k. unfold safer, ttf, seen, ball. split; [intros [-> | Q] | split; [intros [Q Q'] No; apply No |
    split; [intros -> No | intros [Q Q'] No]]]; naturals; simpl in *; cases.
Qed.

Lemma room : forall z y, reads_as integrator z y -> ball 163 y -> look_ahead integrator (ball 200) 31 z.
Proof. intros z y Rd Hy. apply look. unfold ball in *. specialize (Rd tt). simpl in Rd. lra. Qed.
Lemma seen_room : forall k, ac k -> ball 163 (seen k).
Proof. unfold ac, ball, seen. intros k [[Q Q'] | Q]; naturals; cases. Qed.
Lemma first_dm : forall k, dm_release T k <= sc_release T 0 -> dm_release T k <= 0.
Proof. intros k Q. destruct (below k 0); times. Qed.
Lemma K_core : core integrator answers (delta T) (window T) (state_age T) (ball 220) (ball 200).
Proof. rewrite T_window, T_age. apply kept; unfold ball; intros; lra. Qed.
Lemma begins : look_ahead integrator (ball 200) (h_0 T (sc_release T 0) 0) (X 0).
Proof. apply look. times. unfold ball, X. cases. Qed.
Theorem flight_safe : forall t, 0 <= t -> ball 220 (X t).
Proof. apply (safe integrator T answers flight T_holds 0 0) with (ball 200) 31 ttf safer;
    [intros; exact I | exact first_dm | unfold ball; intros; lra | exact K_core | exact begins | | | |].
  - intros k Ac. change (ac k) in Ac. unfold ac in Ac. exists (20 * INR k - 1), (seen k).
    pose proof (dm_goes_by_its_predicates k) as (D1 & D2 & _).
    assert (1 <= INR k) by (apply (le_INR 1); lia). simpl. unfold seen. repeat split; try lra.
    assert (Q : (k = 1 \/ 14 <= k \/ 2 <= k <= 8)%nat) by lia. destruct Q as [Q | [Q | Q]]; auto.
  - intros z y _ Rd [Ok | Ok]; apply room with y; auto; [apply NNPP in Ok |]; unfold safer, ball in *; simpl in *; lra.
  - rewrite T_H. lra.
  - left. intros; exact I.
Qed.

(* SC takes over with its output 9, after verdict 9; it gives control back with verdict 14, in the time of P2b. *)
Theorem flight_returns : exists k, ac k /\ 187 <= 20 * INR k + 2 <= 189 + 140 + 4 + 2 + 20 + 1 + 1.
Proof. assert (Home : ball (80 + INR 7 * 14) (X (20 * INR 9 + 9))) by (unfold ball; simpl; cases).
  apply (comes_home (ball 220)) in Home.
  destruct (control_returns integrator T answers flight (ball 220) (ball 200) (ball 80) safer (INR 7 * 20) 9)
    as (k & Ac & Hk).
  1, 2: solve [exact T_holds | exact K_core].
  - rewrite T_window, T_age. apply kept; [lra | |]; unfold ball, safer.
    + intros z Hz y Rd. specialize (Rd tt). simpl in Rd. unfold ball. lra.
    + intros z Hz. specialize (Hz z ltac:(intros []; simpl; lra)). unfold ball in Hz. simpl in *. lra.
  - intros; exact I.
  - intros (k & Hk & Ac & Last). specialize (Last 9%nat ltac:(simpl; lra)). simpl in Hk.
    assert (k <= 9)%nat by (apply below; simpl; lra). change (ac k) in Ac. unfold ac in Ac. lia.
  - intros t Ht. apply flight_safe. lra.
  - unfold ball. simpl. cases.
  - rewrite T_window, T_age. exact Home.
  - intros k Hk. exists (20 * INR k - 1), (seen k). simpl in *. unfold seen. repeat split; try lra. intros Sf.
    assert (10 <= k)%nat by (apply below; simpl; lra). right.
    destruct (Nat.le_gt_cases 14 k); auto. exfalso. apply (dm_goes_by_its_predicates k); auto; lia.
  - exists k. split; [exact Ac |]. rewrite T_window in Hk. simpl in *. lra.
Qed.

(* The gate, in the same flight: each judgement is about R(H), which is less than R_V(H) would be. *)
Definition judgement s now := 0 <= s <= now - 2 /\ ball 163 (X s + 2).
Lemma past : forall s now, judgement s now -> 0 <= s <= now. Proof. intros s now [S _]. lra. Qed.
Lemma silent : forall k, says_ac flight k -> exists s now, judgement s now /\ dm_release T k - age T <= s /\
  dm_start flight k <= now <= dm_out flight k /\
  forall i e a v, emitted flight i e a v -> now < e <= dm_out flight k -> ac_mode flight e.
Proof. intros k Ac. change (ac k) in Ac. assert (1 <= INR k) by (apply (le_INR 1); unfold ac in Ac; lia).
  exists (20 * INR k - 1), (20 * INR k + 1). split; [| times; split; [lra | split; [lra |]]].
  - split; [lra | apply (seen_room k Ac)].
  - intros i e a v [(-> & _) | (m & -> & _)] He; [lra |]. destruct (nat_apart k m) as [[Q _] | [Q _]]; lra.
Qed.
Lemma published_judged : forall i e a v, emitted flight i e a v -> 0 <= e -> ac_mode flight e ->
  exists s, judgement s e /\ forall k, dm_start flight k <= e -> dm_release T k - age T <= s.
Proof. intros i e a v [(-> & -> & ->) | (m & -> & -> & ->)] E0 (k & Hk & Ac & Last); [lra |]. simpl in *.
  exists (20 * INR m + 3). pose proof (pos_INR m). split; [split; [lra |] |].
  - assert (m <= k)%nat by (apply Last; lra). assert (k <= m)%nat by (apply below; lra).
    replace k with m in Ac by lia. change (ac m) in Ac. unfold ac, ball in *.
    destruct Ac as [[Q Q'] | Q]; naturals; cases.
  - intros k' Hk'. times. destruct (below k' m); lra.
Qed.
Lemma in_turn : forall t, (exists i e a v, emitted flight i e a v /\ e < t) ->
  exists i e a v, emitted flight i e a v /\ e < t /\ forall i' e' a' v', emitted flight i' e' a' v' -> e' < t -> e' <= e.
Proof. intros b (i & e & a & v & E & Hb). destruct (Rle_or_lt b 7) as [Q | Q].
  - exists tt, (-1), (-1), 0. split; [left; auto |].
    destruct E as [(-> & _) | (m & -> & _)]; [| pose proof (pos_INR m); lra].
    split; auto. intros _ e a' v' [(-> & _) | (m & -> & _)] Hb'; [lra | pose proof (pos_INR m); lra].
  - destruct (next_release 7 20 b) as [[| m] Hm]; [lra | lra | simpl in Hm; lra |]. rewrite S_INR in Hm.
    exists tt, (20 * INR m + 7), (20 * INR m + 9), (command m). split; [right; exists m; auto | split; [lra |]].
    intros _ e' a' v' [(-> & _) | (k & -> & _)] Hb'; [pose proof (pos_INR m); lra |].
    destruct (below k m); lra.
Qed.
Theorem flight_gated : forall t, 0 <= t -> ball 220 (X t).
Proof. apply (gate_safe integrator T answers flight T_holds judgement past silent published_judged
    in_turn 0 0) with (ball 200) 31; [intros; exact I | exact first_dm | unfold ball; intros; lra | exact K_core |
    exact begins | rewrite T_H; lra | | intros; exact I].
  intros s now [S B]. split; [lra |]. exists (X s + 2). split; [intros []; simpl; lra |].
  intros z Rd. apply gate_refuses_no_more, room with (X s + 2); auto.
Qed.

(* Decisions by tubes, in the same flight: rest is |x| <= 80, and SC keeps |x| <= 200 from there, by the rule of boxes. *)
Lemma boxed : keeps integrator answers 20 4 5 (ball 220) (ball 80) (ball 200).
Proof. apply box_rests with 1%nat; [lra | lra | lia | unfold ball; intros; lra |]. intros x u act al out t0 b R H0.
  pose proof (last_window integrator answers 20 4 5 _ x u act al out t0 b 0 R) as W0.
  pose proof (last_window integrator answers 20 4 5 _ x u act al out t0 b 1 R) as W1. simpl in *.
  destruct R as [_ La Bg _ U Cm Rd F]. destruct (La 0%nat) as [_ [[] L0]]. destruct (La 1%nat) as [_ [[] L1]].
  split; intros t Ht Lt.
  - pose proof (moves_by x u 0 b (al 0%nat) t F U ltac:(lra) ltac:(lra)). unfold ball in *. lra.
  - destruct (Rd 0%nat) as (y & S4 & Rp); [exists tt; lra |]. destruct (Rp tt) as (s & S0 & S1 & S2 & S3).
    specialize (S2 tt).
    destruct (F (al 0%nat) (al 0%nat + 16) (law y) (law y)) as [R1 R2]; [lra | lra | |].
    { intros q Hq. rewrite (Cm 0%nat tt q), S4 by lra. lra. }
    pose proof (moves_by x u 0 b s (al 0%nat) F U ltac:(lra) ltac:(lra)).
    pose proof (moves_by x u 0 b (al 0%nat + 16) t F U ltac:(lra) ltac:(lra)). unfold ball in *. simpl in *.
    unfold law in *. destruct (Rlt_dec 40 y); [| destruct (Rlt_dec y (-40))]; lra.
Qed.

Lemma at_rest : rest_pair integrator answers 20 4 5 (ball 80) (fun _ => ball 200) (ball 220).
Proof. pose (none := fun i : Empty_set => match i return R with end).
  apply (rules_rest integrator answers 20 4 5 ltac:(lra) ltac:(lra) (ball 80) _ (ball 220) Empty_set (fun i _ => none i)
    (fun i _ => none i) none (ball 80) (ball 200) boxed); auto; [| intros []].
  intros z Hz. split; [exact Hz | intros []].
Qed.

Lemma sc_comes_to_rest : forall (near : R -> Prop) a h m, (forall z, near z -> ball 165 z) -> 0 <= a -> h <= 31 ->
  200 <= m -> good integrator answers 20 4 5 (ball 80) (fun _ => ball 200) near a h 9 (ball m).
Proof. intros near a h m Nr A Hh Hm x u act al out t0 b F. pose proof (fb_begins _ _ _ _ _ _ _ _ _ _ _ _ _ _ _ F) as Bg.
  assert (U0 : forall t, 0 <= t <= b -> t <= al 0%nat -> ball 200 (x t)).
  { intros t Ht L. pose proof (moves_by x u 0 b 0 t (fb_flow _ _ _ _ _ _ _ _ _ _ _ _ _ _ _ F)
      (fb_inputs _ _ _ _ _ _ _ _ _ _ _ _ _ _ _ F) ltac:(lra) ltac:(lra)) as Mv.
    pose proof (Nr _ (fb_near _ _ _ _ _ _ _ _ _ _ _ _ _ _ _ F)). unfold ball in *. lra. }
  assert (Q : forall N, (forall t, 0 <= t <= b -> t <= al N -> ball 200 (x t)) /\
    (al N <= b -> ball (Rmax 80 (200 - 14 * INR N)) (x (al N)))).
  { induction N as [| N [IH1 IH2]].
    - split; auto. intros L. simpl. replace (Rmax 80 (200 - 14 * 0)) with 200 by (unfold Rmax; destruct Rle_dec; lra).
      apply U0; lra.
    - destruct (Rle_or_lt (al N) b) as [L | L]; [| split; [intros t Ht _; apply IH1; lra |]].
      + pose proof (fall_back_suffix integrator answers 20 4 5 ltac:(lra) ltac:(lra) (ball 220) _ _ _ _ _ _ _ _ _ _ N F A L
          ltac:(intros t Ht; specialize (IH1 t ltac:(lra) ltac:(lra)); unfold ball in *; lra)) as Run.
        pose proof (Rmax_l 80 (200 - 14 * INR N)). pose proof (pos_INR N).
        destruct (one_period _ _ _ _ _ _ _ _ (Rmax 80 (200 - 14 * INR N)) Run) as [P1 P2]; auto;
          rewrite ?Nat.add_0_r, ?Nat.add_1_r in *; auto. split.
        * intros t Ht Lt. destruct (Rle_or_lt t (al N)); [auto |]. specialize (P1 t).
          unfold ball, Rmin, Rmax in *. repeat destruct Rle_dec; lra.
        * intros L'. specialize (P2 L'). rewrite S_INR. unfold ball, Rmax in *. repeat destruct Rle_dec; lra.
      + intros L'. pose proof (proj2 (fall_back_ordered _ _ 20 4 5 ltac:(lra) _ _ _ _ _ _ _ _ _ _ N F)). exfalso.
        pose proof (proj1 (fall_back_ordered _ _ 20 4 5 ltac:(lra) _ _ _ _ _ _ _ _ _ _ N F)).
        pose proof (proj1 (fall_back_ordered _ _ 20 4 5 ltac:(lra) _ _ _ _ _ _ _ _ _ _ (S N) F)).
        rewrite S_INR in *. lra. }
  split.
  - intros N _ (Lb & _) _ t Ht. pose proof (proj1 (Q N) t ltac:(lra) ltac:(lra)). unfold ball in *. lra.
  - intros No. assert (Late : b < al 9%nat).
    { apply Rnot_le_lt. intros L. apply (No 9%nat); auto. pose proof (proj2 (Q 9%nat) L) as B. split; auto.
      simpl in B. unfold ball, Rmax in *. destruct Rle_dec; split; intros; lra. }
    split; auto. intros t Ht. pose proof (proj1 (Q 9%nat) t Ht ltac:(lra)). unfold ball in *. lra.
Qed.

(* Two maps: one shows an obstacle that the other does not. *)
Definition safe_with (m : bool) := ball (if m then 210 else 220).
Lemma maps_show : forall m z, safe_with m z -> ball 220 z.
Proof. intros [] z; unfold safe_with, ball; lra. Qed.
Definition sc_seen m (_ : unit) := 20 * INR m + 4. Definition dm_seen k := 20 * INR k - 1.
Lemma T_alpha : alpha T 31 = 19. Proof. unfold alpha. rewrite T_window. times. Qed.
Lemma rest_holds : rest_pair integrator answers (delta T) (window T) (state_age T) (ball 80) (fun _ => ball 200) (ball 220).
Proof. rewrite T_window, T_age. exact at_rest. Qed.
Lemma sc_reads : forall m, counts flight m -> exists y, answers y (out flight m) /\ forall p : topic integrator,
  0 <= sc_seen m p /\ sc_start flight m - sc_age T <= sc_seen m p <= sc_start flight m /\
  shows integrator p (X (sc_seen m p)) y.
Proof. intros m _. exists (X (20 * INR m + 4) + 2). split; [reflexivity | intros p]. unfold sc_seen. pose proof (pos_INR m).
  simpl. repeat split; lra.
Qed.
Lemma verdicts_good : forall k, says_ac flight k -> 0 <= dm_seen k /\
  dm_start flight k - age T <= dm_seen k <= dm_start flight k /\ reads_as integrator (X (dm_seen k)) (seen k) /\
  good integrator answers (delta T) (window T) (state_age T) (ball 80) (fun _ => ball 200)
    (fun z => reads_as integrator z (seen k)) (alpha T 31) 31 9 (safe_with (Nat.even k)).
Proof. intros k Ac. change (ac k) in Ac. assert (1 <= INR k) by (apply (le_INR 1); unfold ac in Ac; lia).
  unfold dm_seen. rewrite T_alpha, T_window, T_age. split; [lra | split; [simpl; lra | split; [intros []; unfold seen; simpl; lra |]]].
  apply sc_comes_to_rest; try lra; [| destruct (Nat.even k); lra].
  intros z Rd. pose proof (seen_room k Ac). unfold ball in *. specialize (Rd tt). simpl in Rd. lra.
Qed.
Lemma reads_go_on : forall ends k m, says_ac flight k -> dm_start flight k <= sc_start flight m ->
  sc_out flight m < ends -> counts flight m /\ forall p, dm_seen k <= sc_seen m p.
Proof. intros ends k m _ Q _. simpl in *. unfold dm_seen, sc_seen. destruct (below k m); [lra |]. split; [exact I | intros _; lra]. Qed.

(* SC may have a memory: this one remembers what it said last. *)
Definition in_U (v : R) := -1 <= v <= 1.
Definition law_step (y : estimate integrator) (_ : unit) (_ : R) : option ((component integrator -> value integrator) * R) :=
  Some (fun _ => law y, law y).
Theorem flight_remembers : forall y : nat -> R, forall m l,
  remembers integrator R unit in_U law_step (fun _ _ l => Some l) y (fun _ => tt) m l ->
  exists v l', law_step (y m) tt l = Some (v, l') /\ answers (y m) v.
Proof. intros y m l Rm. destruct (memory_kept integrator R unit in_U (fun _ _ => True) law_step (fun _ _ l => Some l))
    with (y := y) (o := fun _ : nat => tt) (m := m) (l := l) as [_ K]; auto.
  - intros z o l0 _ Hl. split; [eauto |]. exists (fun _ => law z), (law z). repeat split; simpl; unfold in_U in *; cases.
  - destruct (K l (or_introl eq_refl)) as (v & l' & E & _ & _). exists v, l'. split; auto. injection E. intros _ <-.
    reflexivity.
Qed.

Lemma starts_well : good integrator answers (delta T) (window T) (state_age T) (ball 80) (fun _ => ball 200) (eq (X 0))
  (alpha_0 T 0 0) (h_0 T (sc_release T 0) 0) 9 (safe_with true).
Proof. rewrite T_window, T_age. unfold alpha_0. apply sc_comes_to_rest; [| apply Rmax_l | times | lra].
  intros z <-. unfold ball. cases.
Qed.

Theorem flight_decided : forall t, 0 <= t -> ball 220 (X t).
Proof. intros t T0. apply (implicit_safe integrator T answers flight T_holds bool safe_with (ball 80) (fun _ => ball 200) (ball 220)
    maps_show rest_holds 31 9) with dm_seen sc_seen seen Nat.even t 0%nat 0 true.
  - rewrite T_H. lra.
  - exact sc_reads.
  - exact verdicts_good.
  - apply reads_go_on.
  - intros; exact I.
  - exact first_dm.
  - exact starts_well.
  - apply maps_show.
  - intros k _. apply maps_show.
  - lra.
Qed.

(* Under verdict 8 SC takes over; it is at rest when the DM looks for verdict 14. *)
Theorem flight_decided_returns : exists k, (8 < k)%nat /\ ac k /\ 20 * INR k + 2 <= 159 + 31 + 184 + 2 + 20 + 1 + 1.
Proof. destruct (decided_returns integrator T answers flight T_holds bool safe_with (ball 80) (fun _ => ball 200) (ball 220)
    maps_show rest_holds 31 9 ltac:(rewrite T_H; lra) dm_seen sc_seen seen Nat.even sc_reads verdicts_good 500 (reads_go_on 500) 8)
    as (k & K1 & K2 & K3 & _).
  - left. lia.
  - unfold at_rest_by, dm_seen. rewrite T_window. simpl. lra.
  - intros k Hk. unfold at_rest_by, dm_seen in *. rewrite T_window in Hk. simpl in Hk. split; [simpl; lra |].
    intros _ _ _. right. destruct (Nat.le_gt_cases 14 k) as [L | L]; auto. naturals. lra.
  - exists k. split; [exact K1 | split; [exact K2 |]]. unfold at_rest_by, dm_seen in K3. rewrite T_window in K3.
    simpl in *. lra.
Qed.

(* Each command judged when it is published, by tubes. *)
Theorem flight_judged : forall t, 0 <= t -> ball 220 (X t).
Proof. intros t T0. apply (gated_safe integrator T answers flight T_holds bool safe_with (ball 80) (fun _ => ball 200) (ball 220)
    maps_show rest_holds 31 9 ltac:(rewrite T_H; lra) sc_seen sc_reads t 0 0 true) with judgement; try lra;
    [intros; exact I | exact first_dm | exact starts_well | apply maps_show | | exact silent | exact published_judged |
     exact in_turn |].
  - intros s now [S B]. split; [lra |]. exists (X s + 2), true. split; [intros []; simpl; lra | split; [apply maps_show |]].
    apply good_gated. rewrite T_window, T_age. apply sc_comes_to_rest; try lra.
    intros z Rd. unfold ball in *. specialize (Rd tt). simpl in Rd. lra.
  - intros s now m [S B] Hm _. split; [exact I | intros p]. simpl in *. unfold sc_seen. lra.
Qed.
