(* Modules that assume what others guarantee.
   Purpose: "Composition" of proof-modules.md, and with it groups that read each other: projection of influences.
   Non-goals: promises of progress; who guarantees what in a program. *)
Require Import Reals Lra Lia.
From Soter Require Import Releases.
Open Scope R_scope.
Section Composition.
Variables M X V W : Type.                        (* modules; states of all; influences; choices *)
Variable influence : M -> X -> V.                (* what others feel of a module *)
Variable promised : M -> V -> Prop.              (* V_h *)
Variable project : M -> V -> V.
Hypothesis project_into : forall m v, promised m (project m v).
Hypothesis project_stays : forall m v, promised m v -> project m v = v.
(* run c v x: x solves the equations with choices c (schedules, disturbances, errors, what ACs publish) from their start
   on, where v is what modules feel of each other. *)
Variable run : W -> (R -> M -> V) -> (R -> X) -> Prop.
Hypothesis run_same : forall c v w x, (forall t m, 0 <= t -> v t m = w t m) -> run c v x -> run c w x.
Definition original c x := run c (fun t m => influence m (x t)) x.
Definition changed c x := run c (fun t m => project m (influence m (x t))) x.

(* Each module's theorem, with whatever is promised in the place of what it feels of the others. *)
Hypothesis theorem_of : forall m c v x, (forall t m', 0 <= t -> promised m' (v t m')) -> run c v x ->
  forall t, 0 <= t -> promised m (influence m (x t)).
(* The changed equations have a solution, and from event to event the original ones have one only. *)
Hypothesis solvable : forall c, exists y, changed c y.
Variable event : nat -> R.
Hypothesis events_go_on : forall t, exists n, t <= event n.
Hypothesis one_start : forall c x y, original c x -> original c y -> forall t, 0 <= t <= event 0 -> x t = y t.
Hypothesis unique : forall c x y n, original c x -> original c y -> (forall t, 0 <= t <= event n -> x t = y t) ->
  forall t, 0 <= t <= event (S n) -> x t = y t.

Theorem all_promises_hold : forall c x, original c x -> forall m t, 0 <= t -> promised m (influence m (x t)).
Proof. intros c x Ox m t T0. destruct (solvable c) as [y Cy].
  assert (Py : forall m t, 0 <= t -> promised m (influence m (y t))).
  { intros m' t' T'. apply (theorem_of m' c _ y (fun r k _ => project_into k (influence k (y r))) Cy t' T'). }
  assert (Oy : original c y).
  { apply (run_same c _ _ y (fun r k Hr => project_stays k _ (Py k r Hr)) Cy). }
  assert (Same : forall n r, 0 <= r <= event n -> x r = y r).
  { induction n; intros r Hr; [apply (one_start c) | apply (unique c x y n)]; auto. }
  destruct (events_go_on t) as [n Hn]. rewrite (Same n t); auto.
Qed.
End Composition.
