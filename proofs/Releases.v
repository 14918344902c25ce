(* Releases p, p + d, p + 2d, ... of two components, and the differences between them.
   Purpose: "Ages" of docs/proof.md, the two figures r and G; times are whole numbers of one unit there.
   Non-goals: ages over nodes between sensor and module. *)
Require Import Reals Lra Lia ZArith Classical.
Open Scope R_scope.
Lemma enough_steps : forall a e, 0 < e -> exists n, a < INR n * e.
Proof. intros a e He. destruct (archimed (a / e)) as [U _]. exists (Z.to_nat (up (a / e))).
  assert (Q : a < IZR (up (a / e)) * e).
  { apply (Rmult_lt_compat_r e) in U; auto. unfold Rdiv in U. rewrite Rmult_assoc, Rinv_l in U; lra. }
  rewrite INR_IZR_INZ. destruct (Z_le_gt_dec 0 (up (a / e))) as [Z | Z]; [rewrite Z2Nat.id; auto |].
  assert (IZR (up (a / e)) < 0) by (apply IZR_lt; lia). replace (Z.to_nat (up (a / e))) with 0%nat by lia. simpl. nra.
Qed.

Lemma next_release : forall p d t, 0 < d -> p < t + d -> exists m, t <= p + INR m * d < t + d.
Proof. intros p d t Hd Hp. destruct (enough_steps (t - p) d Hd) as [n Hn].
  assert (Q : t <= p + INR n * d) by lra. clear Hn. induction n; [exists 0%nat; simpl in *; lra |].
  destruct (Rle_or_lt t (p + INR n * d)); auto. exists (S n). rewrite S_INR in *. lra.
Qed.

Lemma least : forall (A : nat -> Prop) n, A n -> exists m, A m /\ forall k, A k -> (m <= k)%nat.
Proof. intros A n. induction n using (well_founded_induction lt_wf). intros An.
  destruct (classic (exists k, (k < n)%nat /\ A k)) as [[k [L Ak]] | Q]; [eauto |].
  exists n. split; auto. intros k Ak. destruct (Nat.le_gt_cases n k); auto. exfalso; eauto.
Qed.

Lemma last_below : forall (A : nat -> Prop) n, (exists k, (k < n)%nat /\ A k) ->
  exists j, (j < n)%nat /\ A j /\ forall k, (j < k < n)%nat -> ~ A k.
Proof. induction n as [| n IH]; intros (k & Kn & Ak); [lia |].
  destruct (classic (A n)) as [An | An]; [exists n; repeat split; auto; lia |].
  destruct IH as (j & Jn & Aj & Q); [exists k; split; auto; assert (k <> n) by congruence; lia |].
  exists j. repeat split; auto. intros k' Hk'. destruct (Nat.eq_dec k' n) as [-> |]; auto. apply Q. lia.
Qed.

(* Differences between releases are r + q g, g the gcd of the periods: r at least, d - g + r where less than d. *)
Lemma differences : forall pd ps D d k m, (0 < D)%Z -> (0 < d)%Z ->
  let g := Z.gcd D d in let r := ((ps - pd) mod g)%Z in let a := (ps + m * d - (pd + k * D))%Z in
  (0 <= r < g /\ (0 <= a -> r <= a /\ (a < d -> a <= d - g + r)))%Z.
Proof. intros pd ps D d k m HD Hd g r a.
  assert (Hg : (0 < g)%Z) by (pose proof (Z.gcd_nonneg D d); destruct (Z.eq_dec g 0) as [E |]; [| lia];
    apply Z.gcd_eq_0_l in E; lia).
  destruct (Z.gcd_divide_l D d) as [D' ED]. destruct (Z.gcd_divide_r D d) as [d' Ed].
  fold g in ED, Ed. assert (Em : (a mod g = r)%Z).
  { unfold a, r. replace (ps + m * d - (pd + k * D))%Z with (ps - pd + (m * d' - k * D') * g)%Z by (rewrite ED, Ed; ring).
    apply Z.mod_add. lia. }
  assert (Hr : (0 <= r < g)%Z) by (apply Z.mod_pos_bound; lia). split; [exact Hr | intros Ha].
  pose proof (Z.div_mod a g ltac:(lia)) as Q. rewrite Em in Q. assert (0 <= a / g)%Z by (apply Z.div_pos; lia).
  split; [nia |]. intros L. assert (a / g < d')%Z by (apply Z.mul_lt_mono_pos_r with g; lia).
  assert ((a / g + 1) * g <= d' * g)%Z by (apply Z.mul_le_mono_nonneg_r; lia). lia.
Qed.

(* What Module.v asks of r and G, from periods and phases in whole numbers. *)
Theorem r_and_G : forall pd ps D d, (0 < d <= D)%Z -> (0 <= pd)%Z -> (0 <= ps < d)%Z ->
  let g := Z.gcd D d in let r := ((ps - pd) mod g)%Z in let G := (d - g + r)%Z in
  let dm k := IZR pd + INR k * IZR D in let sc m := IZR ps + INR m * IZR d in
  (forall k m, dm k <= sc m -> dm k + IZR r <= sc m) /\
  (forall k, exists m, dm (S k) <= sc m <= dm (S k) + IZR G) /\ IZR G < IZR D.
Proof.
  intros pd ps D d HD Hpd Hps g r G dm sc. pose proof (fun k m => differences pd ps D d k m ltac:(lia) ltac:(lia)) as Q.
  cbv zeta in Q. fold g r in Q. unfold dm, sc. split; [| split].
  - intros k m Hk. rewrite !INR_IZR_INZ, <- !mult_IZR, <- !plus_IZR in *. apply le_IZR in Hk. apply IZR_le.
    specialize (Q (Z.of_nat k) (Z.of_nat m)). lia.
  - intros k. assert (IZR ps < IZR d /\ 0 < IZR d <= IZR D /\ 0 <= IZR pd) as (B1 & B2 & B3).
    { repeat split; try apply IZR_lt; try apply IZR_le; lia. }
    pose proof (pos_INR (S k)). destruct (next_release (IZR ps) (IZR d) (dm (S k))) as [m Hm]; [lra | unfold dm; nra |].
    exists m. split; [apply Hm |]. unfold dm in Hm. rewrite !INR_IZR_INZ, <- !mult_IZR, <- !plus_IZR in *.
    destruct Hm as [M1 M2]. apply le_IZR in M1. apply lt_IZR in M2. apply IZR_le.
    specialize (Q (Z.of_nat (S k)) (Z.of_nat m)). unfold G. lia.
  - apply IZR_lt. specialize (Q 0%Z 0%Z). unfold G. lia.
Qed.
