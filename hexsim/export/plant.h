/* An instance of the machine's plant, and what may be asked of it.

   machine.h, written at export, holds the machine: counts, places of states and numbers, variables, the MuJoCo model. */
#pragma once
#include <math.h>
#include <mujoco/mujoco.h>
#include <stdbool.h>
#include <stddef.h>

#include "machine.h"

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef unsigned int Reference;
typedef const char *String;
typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } Status;

/* MuJoCo as this FMU calls it: linked, or on Windows loaded from the FMU's own folder. */
#define MUJOCO_FUNCTIONS(X) \
  X(loadModelBuffer) X(makeData) X(deleteData) X(deleteModel) X(setConst) X(resetData) X(forward) X(step) \
  X(checkAcc) X(RungeKutta) X(stateSize) X(getState) X(setState) X(versionString)
#define CALLBACKS(X) X(act_dyn) X(act_bias)
typedef struct {
#define X(name) __typeof__(&mj_##name) name;
  MUJOCO_FUNCTIONS(X)
#undef X
#define X(name) __typeof__(&mjcb_##name) name;
  CALLBACKS(X)
#undef X
} Mujoco;
extern Mujoco mj;
bool find_mujoco(void); /* whether `mj` is filled */

#define MPa 1e6
#define FIRST_OUTPUT N_INPUTS
#define FIRST_PARAMETER (FIRST_OUTPUT + N_OUTPUTS)
#define TIME (FIRST_PARAMETER + N_PARAMETERS) /* FMI 3.0's independent variable */

/* All of an instance that MuJoCo does not hold; a plain block of numbers, so that it can be kept and written out. */
typedef struct {
  double parameters[N_PARAMETERS + 1];
  double inputs[N_INPUTS];     /* volts, or setpoints of the motion computer */
  double volts[N_LEGS];        /* commanded */
  double setpoints[N_LEGS];    /* of the legs, and */
  double memory[IS_MACHINE ? N_LEGS * N_MEMORY : 1]; /* what the controllers remember */
  double compensators[IS_MACHINE ? N_LEGS : 1][COMPENSATOR_SIZE]; /* what the compensators remember, */
  double commanded[N_LEGS];    /* and the volts before the computing delay */
  double seen[N_SEEN + 1];     /* positions and forces of the legs of late */
  double spool_volts[N_LEGS];  /* after delay and hysteresis */
  double apart[N_LEGS];        /* the valves' two plays */
  double past[RING][N_LEGS];   /* the last commands that differ, */
  double since[RING];          /* and the time from which each holds [s] */
  double commands;             /* how many there were */
  double rule[4];              /* StepRule */
  double calm_s[2], velocity_before[N_LEGS]; /* what the choice of steps remembers: time since standstill, last choice */
  double is_started;           /* parameters are in the model, the state is the static equilibrium or later */
  double start_time;           /* of the tool [s] */
} Numbers;

typedef struct Instance {
  mjModel *model;
  mjData *data;
  Numbers now;
  double outputs[N_OUTPUTS];
  bool outputs_hold; /* for the present state */
  bool is_initialised;
  void (*say)(const struct Instance *, String text);
  int has_stop_time; /* the importer has named one [s], beyond which no step goes */
  double stop_time;
  void *logger, *environment; /* of the tool */
  char *name;
} Instance;

/* The compiled equations. */
double hexsim_act_dyn(const mjModel *, const mjData *, int);
double hexsim_act_bias(const mjModel *, const mjData *, int);
void hexsim_hysteresis(double volts, double *spool_volts, double *apart, double half_width, double spread);
double hexsim_stiffness(const double *row, double *coefficients);                  /* N_STIFF of them */
double hexsim_rule(const double *fastest, const double *supply_row, double *rule); /* fastest eigenvalue of each */
double hexsim_choose(const double *user, const double *act, const double *ctrl, const double *length, const double *velocity,
                     double *velocity_before, double *calm_s, const double *rule, double *timestep, double ticks, double span);
                     /* gives the steps */

/* Motion computer: positions and pressures are read in place; `path`: setpoints as the loops follow them. */
double hexsim_control(const double *inputs, double *position, double *bottom, const double *top, double *supply, double *memory,
                      double *setpoints, double *path, double *forward, double *asked, double is_first);
double hexsim_command(double *memory, const double *asked, double *commanded, double *volts);
int COMPENSATOR(init)(double *state, const double *settings);
int COMPENSATOR(step)(double *state, double setpoint, const double *preview, int count, double position, double control,
                      double forward, double valve, double bottom, double top, double supply, double *added);
void COMPENSATOR(hear)(double *state, const double *other);
/* What a platform's legs do together, where the compensators are given it: N_SEEN. */
void COMPENSATOR(feel)(double *state, double load, const double *mobility, const double *forces, const double *speeds, int count);
void hexsim_watch_legs(const double *position, const double *bottom, const double *top, const double *supply, double *seen,
                       double *mobility, double *load, double *forces, double *speeds, double is_first);

/* plant.c */
Status refuse(const Instance *c, const char *format, ...); /* through the logger; gives ERROR */
void forget_warnings(Instance *c);
void put_parameters(Instance *c); /* into the model */
Status start(Instance *c);        /* parameters into the model, static equilibrium at neutral */
Status advance(Instance *c, double span);
void evaluate(Instance *c); /* outputs of the present state */

/* instance.c: what both versions of FMI ask for */
Instance *new_instance(String name, String guid, void (*say)(const Instance *, String), void *logger, void *environment);
void free_instance(Instance *c);
void set_start_values(Instance *c);
Status end_initialisation(Instance *c);
Status get_values(Instance *c, const Reference which[], size_t n, double values[]);
Status set_values(Instance *c, const Reference which[], size_t n, const double values[]);
Status do_step(Instance *c, double t, double h);
size_t state_size(const Instance *c);
Status get_state(Instance *c, void **state);
Status set_state(Instance *c, const void *state);
Status write_state(const Instance *c, const void *state, void *bytes, size_t size);
Status read_state(const Instance *c, const void *bytes, size_t size, void **state);
