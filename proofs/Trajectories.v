(* Plants, and look-ahead sets defined over their trajectories.
   Purpose: "Look-ahead" of docs/proof.md: R(tau), and R_V(H) of a gate that looks at commands.
   Non-goals: how such sets are computed; SC and schedules (ScRuns.v, Module.v). *)
Require Import Reals Lra.
Open Scope R_scope.

(* flow x u a b: on [a, b] the state is x under commands u (one value a component), for some disturbance. It depends on
   x on [a, b] and on u on [a, b), and not on the clock; trajectories are closed under taking parts and concatenation. *)
Record plant := {
  state : Type; component : Type; value : Type; estimate : Type; topic : Type;
  flow : (R -> state) -> (R -> component -> value) -> R -> R -> Prop;
  flow_same : forall x y u v a b, (forall t, a <= t <= b -> x t = y t) ->
    (forall t, a <= t < b -> u t = v t) -> flow x u a b -> flow y v a b;
  flow_moved : forall x u a b s, flow x u a b -> flow (fun t => x (t + s)) (fun t => u (t + s)) (a - s) (b - s);
  flow_part : forall x u a b c d, a <= c <= d -> d <= b -> flow x u a b -> flow x u c d;
  flow_joined : forall x u a b c, a <= b <= c -> flow x u a b -> flow x u b c -> flow x u a c;
  inputs : component -> value -> Prop;        (* U: the values of the gated topics *)
  shows : topic -> state -> estimate -> Prop }. (* shows p x y: what y has of topic p is that of x, plus an error in E *)

(* y = x + e for some error e in E: all topics show one state. *)
Definition reads_as P z y := forall p, shows P p z y.

Section Sets.
Variable P : plant.
Implicit Types (H w : R) (x : R -> state P) (z : state P) (u : R -> component P -> value P) (K : state P -> Prop).

Definition within (Vi : component P -> value P -> Prop) u a b := forall t i, a <= t < b -> Vi i (u t i).

(* R(tau): whatever acts from U, whatever disturbs, K for tau. Trajectories of every length count, so that nothing is
   assumed of solutions for all times. *)
Definition look_ahead K (tau : R) z := forall x u b, 0 <= b <= tau -> x 0 = z ->
  within (inputs P) u 0 b -> flow P x u 0 b -> forall t, 0 <= t <= b -> K (x t).

(* R_V(H): commands are in V until SC's first component acts at t1, in U until its last one does at t2 <= t1 + w. *)
Definition gated_look_ahead K Vi (H w : R) z := forall x u t1 t2,
  0 <= t1 <= t2 -> t2 <= H -> t2 <= t1 + w -> x 0 = z -> within Vi u 0 t1 -> within (inputs P) u 0 t2 ->
  flow P x u 0 t2 -> forall t, 0 <= t <= t2 -> K (x t).

Lemma gated_along : forall K Vi H w x u s t1 t2, s <= t1 <= t2 -> t2 <= s + H -> t2 <= t1 + w ->
  gated_look_ahead K Vi H w (x s) -> within Vi u s t1 -> within (inputs P) u s t2 -> flow P x u s t2 ->
  forall t, s <= t <= t2 -> K (x t).
Proof. intros K Vi H w x u s t1 t2 S1 S2 S3 HR HV HU F t Ht. replace t with (t - s + s) by lra.
  apply (HR (fun q => x (q + s)) (fun q => u (q + s)) (t1 - s) (t2 - s)); try lra.
  - f_equal; lra.
  - intros q i Hq. apply HV; lra.
  - intros q i Hq. apply HU; lra.
  - replace 0 with (s - s) by lra. apply (flow_moved P x u s t2 s F).
Qed.

(* What the DM permits, the gate permits, whatever the command. *)
Theorem gate_refuses_no_more : forall K Vi H w z, look_ahead K H z -> gated_look_ahead K Vi H w z.
Proof. intros K Vi H w z HR x u t1 t2 T1 T2 _ E _ HU F. apply (HR x u t2); auto; lra. Qed.
Lemma look_along : forall K H x u s b, s <= b <= s + H -> look_ahead K H (x s) -> within (inputs P) u s b ->
  flow P x u s b -> forall t, s <= t <= b -> K (x t).
Proof. intros K H x u s b Sb HR HU F. apply (gated_along K (inputs P) H 0 x u s b b); auto; try lra.
  apply gate_refuses_no_more. exact HR.
Qed.

(* The fewer commands may act, the fewer are refused: V may be a larger set than it need be. *)
Lemma gated_fewer : forall K (Vi Vj : component P -> value P -> Prop) H w z, (forall i v, Vi i v -> Vj i v) ->
  gated_look_ahead K Vj H w z -> gated_look_ahead K Vi H w z.
Proof. intros K Vi Vj H w z S HR x u t1 t2 T1 T2 T3 E HV. apply (HR x u t1 t2); auto. intros t i Ht; auto. Qed.

(* Concatenation: the future of x(t) is a future of x(s), so x(t) is in R(s + H - t). *)
Definition glue {T} (c : R) (f g : R -> T) t := if Rlt_dec t c then f t else g t.
Lemma look_ahead_later : forall K H x u s t, s <= t <= s + H -> look_ahead K H (x s) ->
  within (inputs P) u s t -> flow P x u s t -> look_ahead K (s + H - t) (x t).
Proof. intros K H x u s t St HR HU F y v b Hb Ey HV G q Hq.
  set (y' := fun r => y (r + - t)). set (v' := fun r => v (r + - t)).
  assert (Q : forall r, s <= r <= t + b -> K (glue t x y' r)).
  { apply (look_along K H (glue t x y') (glue t u v') s (t + b)); try lra.
    - unfold glue. destruct (Rlt_dec s t) as [Q | Q]; [exact HR |].
      unfold y'. replace (s + - t) with 0 by lra. rewrite Ey. replace t with s by lra. exact HR.
    - intros r i Hr. unfold glue. destruct (Rlt_dec r t); [apply HU | apply HV]; lra.
    - apply flow_joined with t; try lra.
      + apply (flow_same P x _ u); [| | exact F]; intros r Hr; unfold glue.
        * destruct (Rlt_dec r t); auto. unfold y'. replace r with t by lra. replace (t + - t) with 0 by lra. auto.
        * destruct (Rlt_dec r t); [auto | lra].
      + apply (flow_same P y' _ v').
        * intros r Hr. unfold glue. destruct (Rlt_dec r t); [lra | auto].
        * intros r Hr. unfold glue. destruct (Rlt_dec r t); [lra | auto].
        * replace t with (0 - - t) at 1 by lra. replace (t + b) with (b - - t) by lra. apply flow_moved. exact G. }
  assert (E : y q = glue t x y' (t + q)).
  { unfold glue. destruct (Rlt_dec (t + q) t); [lra |]. unfold y'. f_equal. lra. }
  rewrite E. apply Q. lra.
Qed.
End Sets.
