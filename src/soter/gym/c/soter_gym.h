/* soter_gym.h: a program one of whose controllers is answered by somebody else, step by step.
 *
 * Purpose: environments for learners. A step of many worlds is one call, and so is a step of one
 * world whose plant lives outside; numbers in and out lie in arrays of doubles.
 * Non-goals: rewards and ends of episodes, which are functions of the caller's.
 */
#ifndef SOTER_GYM_H
#define SOTER_GYM_H

#include "soter.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum {
  SOTER_LEAF_FLOAT = 0,
  SOTER_LEAF_BOOL = 1, /* any whole number: true unless it is 0 */
  SOTER_LEAF_I8 = 2,   /* ints and enums by how they lie in memory */
  SOTER_LEAF_U8 = 3,
  SOTER_LEAF_I16 = 4,
  SOTER_LEAF_U16 = 5,
  SOTER_LEAF_I32 = 6,
  SOTER_LEAF_U32 = 7,
  SOTER_LEAF_I64 = 8
} soter_leaf_kind;

/* Where one number lies. */
typedef struct {
  uint32_t offset;
  uint32_t kind;
  int64_t low, high; /* of an int or an enum: what its type allows */
} soter_leaf;

typedef struct {
  const soter_leaf* at;
  uint32_t count;
  uint32_t size; /* bytes of the struct that they lie in; of the state 0 */
} soter_leaves;

/* Who is outside, and where the numbers lie. */
typedef struct {
  const soter_program* program;
  int32_t module;  /* whose AC the agent is; -1: the agent is no AC */
  uint32_t looks;  /* of its DM that keep AC, the one that finds `safer` among them */
  int64_t late_ns; /* how late its looks may be */
  uint32_t agent;
  uint32_t plant;        /* answered from outside; as many as there are components: none */
  uint32_t answer_most;  /* bytes of the largest answer of any extern */
  uint32_t plain;        /* what soter_is_plain says of the program */
  soter_leaves action;   /* in the agent's answer */
  soter_leaves given;    /* in it: what says that an output was given */
  soter_leaves moved;    /* in the plant's answer */
  soter_leaves start;    /* the same states, in the state */
  soter_leaves observe;  /* in the state: what an observation is */
  soter_leaves apply;    /* in the state: what the module publishes, or the plant reads */
  soter_leaves outputs;  /* in the state: what the module publishes, where a shield moves that */
  soter_leaves proposed; /* in the state: what AC would have published in the place of it */
} soter_view;

typedef enum {
  SOTER_CAUSE_NONE = 0,
  SOTER_CAUSE_GATE = 1,       /* the gate refused what AC published */
  SOTER_CAUSE_STALE = 2,      /* what the DM reads was too old */
  SOTER_CAUSE_TTF = 3,        /* ttf: AC could have left safe before the next look */
  SOTER_CAUSE_RECOVERING = 4, /* SC keeps control until `safer` */
  SOTER_CAUSE_FORCED = 5,     /* the system forces the module into SC */
  SOTER_CAUSE_TOWARD_SC = 6   /* the shield moved what AC published toward SC's command */
} soter_cause;

/* What is known as the agent is asked. */
typedef struct {
  int64_t time;
  uint32_t violations; /* so far, this instant included */
  uint32_t steps;      /* that the agent took in this episode */
  uint8_t mode, ttf, safer, stale;
  uint8_t switched;   /* the mode is another one than a step ago */
  uint8_t taken_by;   /* the mode in which the step was taken */
  uint8_t gate_fault; /* the gate refused the agent's action */
  uint8_t cause;      /* soter_cause: why it did not count */
  uint8_t next_cause; /* why the next one will not */
  uint8_t off_model;  /* the plant outside did what the program's plant cannot */
  uint8_t moved;      /* the shield moved the agent's action */
  uint8_t reserved[5];
} soter_facts;

/* Whether every release is that of its period, in the deployed order, and no step lasts. */
bool soter_is_plain(const soter_program* p);

/* ------------------------------------------------------------------ many worlds */

typedef struct {
  const soter_view* view;
  uint32_t count;
  uint8_t* states;       /* [count]: states, one after the other */
  const uint8_t* begin;  /* [count]: which begin an episode now, whatever their action is */
  uint64_t* seeds;       /* [count]: of the next episode of each */
  uint64_t stride;       /* from one episode's seed to the next */
  const double* actions; /* [count][view->action.count] */
  double* observations;  /* [count][view->observe.count] */
  double* applied;       /* [count][view->apply.count]: in force after the agent's instant */
  soter_facts* facts;    /* [count] */
  uint8_t* room;         /* a state and the largest answer */
} soter_worlds;

/* Those that `begin`, and no others, begin: they run until the agent is asked for the first time.
 * Gives how many worlds came there: fewer than `count` where one needs another extern. */
uint32_t soter_worlds_begin(const soter_worlds* w);

/* Every world takes its action and runs until the agent is asked again, or begins. */
uint32_t soter_worlds_step(const soter_worlds* w);

/* Which of `count` answers, [count][view->action.count], the agent would publish as they are in
 * each world, were it in control: masks [w->count][count]. */
void soter_worlds_mask(const soter_worlds* w, const double* answers, uint32_t count,
                       uint8_t* masks);

/* ------------------------------------------------------------------ one world, its plant outside
 */

/* The program's own plant, to be asked what it would have done. Its disturbances are states. */
typedef struct {
  const soter_program* program;
  const soter_program* world; /* whose topics it reads: the same topics */
  uint8_t* state;
  uint32_t topics_size;
  uint32_t topics_from; /* where the topics lie in a state of the world */
  uint32_t topics_at;   /* and in this one */
  soter_leaves states;
  soter_leaves drawn;      /* the disturbances */
  const double* low;       /* [drawn]: their bounds */
  const double* high;      /* [drawn] */
  const double* tolerance; /* [states]: absolute; infinite: is not compared */
  double relative;         /* and of the size of a number */
  double* origin;          /* [states]: where the last step began */
  double* chosen;          /* [drawn]: the disturbances that explain it best */
  double* residual;        /* [states]: what they leave */
  double* undisturbed;     /* [states]: what is left with every disturbance at its middle */
  double* work;            /* [states * (drawn + 1)] */
  uint8_t explained;       /* what was said of the last step that was judged */
} soter_model;

typedef struct {
  const soter_view* view;
  uint8_t* state;
  uint8_t* room;      /* a state and the largest answer */
  double* action;     /* [view->action.count] */
  double* states;     /* [view->moved.count]: of the plant */
  double* command;    /* [view->apply.count] */
  float* single;      /* [view->apply.count]: the same, rounded; or NULL */
  soter_facts* facts; /* as of the last time the agent or the plant was due */
  soter_model* model; /* or NULL */
  int64_t margin_ns;  /* as of then: for how long AC surely keeps control, whatever it does */
  uint32_t flags;     /* of the facts all that are small, and whether there was a step */
  uint8_t latched;    /* whether the plant has stopped for ever */
  uint8_t looks;      /* whether violations include the instant that is not over yet */
  uint8_t told;       /* whether the next two are what soter_outside_tell has seen */
  uint32_t told_flags;
  uint32_t told_violations;
} soter_outside;

/* In the place of an index. */
#define SOTER_NO_STATES (-1)  /* what was given is no state of the plant */
#define SOTER_AS_TOLD (-2)    /* the agent is due, and flags and violations are as told */
#define SOTER_NO_NUMBERS (-3) /* what was given is no array that is read as it is */

/* All of these run until an extern is due and give its index. */
int32_t soter_outside_go(soter_outside* o);

/* Writes `states` into a fresh state; -1: they are no values of the plant's states. */
int32_t soter_outside_place(const soter_outside* o);

/* Answers for the agent, with `action`. */
int32_t soter_outside_act(soter_outside* o);

/* Answers for the plant, with `states`; -1 as above. */
int32_t soter_outside_move(soter_outside* o);

/* The same, or SOTER_AS_TOLD. */
int32_t soter_outside_move_on(soter_outside* o);

/* The caller has seen flags and violations. */
void soter_outside_tell(soter_outside* o);

/* Violations so far, the instant that is not over yet included. */
uint32_t soter_outside_violations(const soter_outside* o);

/* The plant is due and `states` is where it went: asks the model whether it can have, and notes in
 * the facts where it cannot. soter_outside_move does so itself. */
void soter_outside_judge(const soter_outside* o);

/* soter_gym_python.c: what it needs of Python. */
typedef struct {
  void* int_of;         /* PyLong_FromLong */
  void* address_of;     /* PyLong_AsVoidPtr */
  void* buffer_of;      /* PyObject_GetBuffer */
  void* buffer_release; /* PyBuffer_Release */
  void* clear_error;    /* PyErr_Clear */
} soter_python;

void soter_python_given(const soter_python* python);

/* soter_outside_act and soter_outside_move_on as PyCFunctions whose `self` is an int, the address
 * of a soter_outside, and whose argument the array of numbers; or SOTER_NO_NUMBERS, and no step. */
void* soter_python_act(void* self, void* action);
void* soter_python_move(void* self, void* states);

/* Whether some disturbances within their bounds lead the model's plant from `origin` to `to`, at
 * the time of a state of the world and with its topics. */
bool soter_model_explains(const soter_model* m, const double* to, void* world);

#ifdef __cplusplus
}
#endif

#endif
