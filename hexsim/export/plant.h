/* An instance of the machine's plant, and what may be asked of it.

   machine.h, written at export, holds the machine: counts, places of states and numbers, variables, the MuJoCo model. */
#pragma once
#include <math.h>
#include <mujoco/mujoco.h>
#include <stddef.h>

#include "machine.h"

typedef void *Component, *State, *Environment;
typedef unsigned int Reference;
typedef int Boolean;
typedef const char *String;
typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } Status;
typedef struct {
  void (*logger)(Environment, String instance, Status, String category, String message, ...);
  void *(*allocate)(size_t, size_t);
  void (*release)(void *);
  void (*finished)(Environment, Status);
  Environment environment;
} Callbacks;

#define MPa 1e6
#define FIRST_OUTPUT N_LEGS
#define FIRST_PARAMETER (FIRST_OUTPUT + N_OUTPUTS)
#define N_VARIABLES (FIRST_PARAMETER + N_PARAMETERS)
#define STATE_BITS (mjSTATE_INTEGRATION)

/* All of an instance that MuJoCo does not hold; a plain block of numbers, so that it can be kept and written out. */
typedef struct {
  double parameters[N_PARAMETERS + 1];
  double volts[N_LEGS];       /* commanded */
  double spool_volts[N_LEGS]; /* after delay and hysteresis */
  double past[RING][N_LEGS];  /* volts of the last time steps */
  double steps;               /* time steps done */
  double is_started;          /* parameters are in the model, the state is the static equilibrium or later */
} Numbers;

typedef struct {
  mjModel *model;
  mjData *data;
  Numbers now;
  double outputs[N_OUTPUTS];
  int outputs_hold; /* for the present state */
  int is_initialised;
  Callbacks callbacks;
  char *name;
} Instance;

double hexsim_act_dyn(const mjModel *, const mjData *, int);
double hexsim_act_bias(const mjModel *, const mjData *, int);
double hexsim_play(double volts, double previous, double half_width);

Status refuse(const Instance *c, const char *format, ...); /* through the logger; gives ERROR */
void forget_warnings(Instance *c);
void put_parameters(Instance *c);                          /* into the model */
Status start(Instance *c);                                 /* parameters into the model, static equilibrium at neutral */
void time_step(Instance *c);
int is_finite(const Instance *c);
void evaluate(Instance *c); /* outputs of the present state */
