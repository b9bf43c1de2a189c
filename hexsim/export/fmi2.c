/* FMI 2.0, co-simulation. Value references: inputs (volts), outputs, parameters, in this order; all are real. */
#include "plant.h"

#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif
EXPORT String fmi2GetTypesPlatform(void) { return "default"; }
EXPORT String fmi2GetVersion(void) { return "2.0"; }
EXPORT Status fmi2SetDebugLogging(Component c, Boolean on, size_t n, const String categories[]) { return OK; }

static void set_start_values(Instance *c) {
  memset(&c->now, 0, sizeof c->now);
  for (int k = 0; k < N_PARAMETERS; k++) c->now.parameters[k] = PARAMETERS[k].start;
  c->is_initialised = 0;
  c->outputs_hold = 0;
}

EXPORT void fmi2FreeInstance(Component instance) {
  Instance *c = instance;
  if (!c) return;
  if (c->data) mj_deleteData(c->data);
  if (c->model) mj_deleteModel(c->model);
  free(c->name);
  free(c);
}

EXPORT Component fmi2Instantiate(String name, int kind, String guid, String resources, const Callbacks *callbacks,
                                 Boolean visible, Boolean logging) {
  Instance *c = calloc(1, sizeof *c);
  if (!c) return NULL;
  if (callbacks) c->callbacks = *callbacks;
  c->name = calloc(strlen(name) + 1, 1);
  if (c->name) strcpy(c->name, name);
  if (kind != 1 || strcmp(guid, GUID)) {
    refuse(c, kind != 1 ? "this FMU is for co-simulation" : "guid is %s in place of " GUID, guid);
    fmi2FreeInstance(c);
    return NULL;
  }
  mjcb_act_dyn = hexsim_act_dyn; /* this MuJoCo is the FMU's own */
  mjcb_act_bias = hexsim_act_bias;
  c->model = mj_loadModelBuffer(MODEL, sizeof MODEL);
  c->data = c->model ? mj_makeData(c->model) : NULL;
  if (!c->data) {
    refuse(c, "MuJoCo %s could not load the model: no memory", mj_versionString());
    fmi2FreeInstance(c);
    return NULL;
  }
  set_start_values(c);
  return c;
}

EXPORT Status fmi2SetupExperiment(Component c, Boolean has_tolerance, double tolerance, double t, Boolean has_end,
                                  double end) {
  return OK;
}
EXPORT Status fmi2EnterInitializationMode(Component instance) { return OK; }
EXPORT Status fmi2ExitInitializationMode(Component instance) {
  Instance *c = instance;
  Status status = c->now.is_started ? OK : start(c);
  c->is_initialised = status == OK;
  return status;
}
EXPORT Status fmi2Terminate(Component c) { return OK; }
EXPORT Status fmi2Reset(Component instance) {
  set_start_values(instance);
  return OK;
}

EXPORT Status fmi2GetReal(Component instance, const Reference which[], size_t n, double values[]) {
  Instance *c = instance;
  for (size_t k = 0; k < n; k++) {
    Reference r = which[k];
    if (r >= N_VARIABLES) return refuse(c, "there is no variable with value reference %u", r);
    if (r < FIRST_OUTPUT) values[k] = c->now.volts[r];
    else if (r >= FIRST_PARAMETER) values[k] = c->now.parameters[r - FIRST_PARAMETER];
    else {
      if (!c->now.is_started && start(c) != OK) return ERROR;
      if (!c->outputs_hold) evaluate(c);
      values[k] = c->outputs[r - FIRST_OUTPUT];
    }
  }
  return OK;
}

static Status set_parameter(Instance *c, const Parameter *p, double value) {
  if (c->is_initialised) return refuse(c, "%s is fixed once the FMU is initialised: set it before, or reset", p->name);
  int between = value >= p->low && value <= p->high && (value == 0 || fabs(value) >= p->zero_or);
  if (!between && p->zero_or > 0)
    return refuse(c, "%s = %g: 0, or %g to %g is possible", p->name, value, p->zero_or, p->high);
  if (!between) return refuse(c, "%s = %g: %g to %g is possible", p->name, value, p->low, p->high);
  c->now.parameters[p - PARAMETERS] = value;
  c->now.is_started = 0;
  return OK;
}

EXPORT Status fmi2SetReal(Component instance, const Reference which[], size_t n, const double values[]) {
  Instance *c = instance;
  for (size_t k = 0; k < n; k++) {
    Reference r = which[k];
    Status status = OK;
    if (r >= N_VARIABLES || (r >= FIRST_OUTPUT && r < FIRST_PARAMETER))
      status = refuse(c, "value reference %u is no input and no parameter", r);
    else if (r >= FIRST_PARAMETER) status = set_parameter(c, &PARAMETERS[r - FIRST_PARAMETER], values[k]);
    else if (!isfinite(values[k])) status = refuse(c, "volts of valve %u are %g: a finite number is needed", r + 1, values[k]);
    else c->now.volts[r] = values[k];
    if (status != OK) return status;
  }
  return OK;
}

EXPORT Status fmi2DoStep(Component instance, double t, double h, Boolean no_return_before) {
  Instance *c = instance;
  double ratio = h / c->model->opt.timestep, n = round(ratio);
  if (!c->is_initialised) return refuse(c, "a step before the initialisation");
  if (!(n >= 1 && fabs(ratio - n) < 1e-6 * n))
    return refuse(c, "communication step %g s is not a whole multiple of the time step %g s", h, c->model->opt.timestep);
  for (double k = 0; k < n; k++) time_step(c);
  c->outputs_hold = 0;
  if (!is_finite(c)) return refuse(c, "the state left the finite numbers before %g s: the motion is beyond the machine", t + h);
  return OK;
}

/* State: [size of MuJoCo's part, is_initialised, Numbers, MuJoCo's part], one block. */
#define HEAD (2 + sizeof(Numbers) / sizeof(double))
static size_t state_size(const Instance *c) { return sizeof(double) * (HEAD + mj_stateSize(c->model, STATE_BITS)); }

EXPORT Status fmi2FreeFMUstate(Component c, State *state) {
  free(*state);
  *state = NULL;
  return OK;
}
EXPORT Status fmi2GetFMUstate(Component instance, State *state) {
  Instance *c = instance;
  double *block = *state ? *state : malloc(state_size(c));
  if (!block) return refuse(c, "no memory for a state");
  block[0] = mj_stateSize(c->model, STATE_BITS);
  block[1] = c->is_initialised;
  memcpy(block + 2, &c->now, sizeof c->now);
  mj_getState(c->model, c->data, block + HEAD, STATE_BITS);
  *state = block;
  return OK;
}
EXPORT Status fmi2SetFMUstate(Component instance, State state) {
  Instance *c = instance;
  const double *block = state;
  if (!block || block[0] != mj_stateSize(c->model, STATE_BITS)) return refuse(c, "the state is not one of this FMU");
  memcpy(&c->now, block + 2, sizeof c->now);
  if (c->now.is_started) put_parameters(c);
  mj_setState(c->model, c->data, block + HEAD, STATE_BITS);
  forget_warnings(c);
  c->is_initialised = block[1] != 0;
  c->outputs_hold = 0;
  return OK;
}
EXPORT Status fmi2SerializedFMUstateSize(Component instance, State state, size_t *size) {
  *size = state_size(instance);
  return OK;
}
EXPORT Status fmi2SerializeFMUstate(Component instance, State state, char bytes[], size_t size) {
  if (size < state_size(instance)) return refuse(instance, "%zu bytes do not hold a state", size);
  memcpy(bytes, state, state_size(instance));
  return OK;
}
EXPORT Status fmi2DeSerializeFMUstate(Component instance, const char bytes[], size_t size, State *state) {
  if (size != state_size(instance)) return refuse(instance, "%zu bytes are no state of this FMU", size);
  if (!*state) *state = malloc(size);
  if (!*state) return refuse(instance, "no memory for a state");
  memcpy(*state, bytes, size);
  return OK;
}

/* What this FMU does not have: variables that are not real, derivatives, steps in the background. */
#define NONE_OF(name, type) \
  EXPORT Status name(Component c, const Reference r[], size_t n, type values[]) { \
    return n ? refuse(c, #name ": all variables are real") : OK; \
  }
NONE_OF(fmi2GetInteger, int) NONE_OF(fmi2GetBoolean, Boolean) NONE_OF(fmi2GetString, String)
NONE_OF(fmi2SetInteger, const int) NONE_OF(fmi2SetBoolean, const Boolean) NONE_OF(fmi2SetString, const String)
#define WITHOUT(name, ...) EXPORT Status name(Component c, __VA_ARGS__) { return refuse(c, #name " is not supported"); }
WITHOUT(fmi2GetDirectionalDerivative, const Reference u[], size_t n, const Reference k[], size_t m, const double d[], double r[])
WITHOUT(fmi2SetRealInputDerivatives, const Reference v[], size_t n, const int order[], const double r[])
WITHOUT(fmi2GetRealOutputDerivatives, const Reference v[], size_t n, const int order[], double r[])
WITHOUT(fmi2GetStatus, int kind, Status *status)
WITHOUT(fmi2GetRealStatus, int kind, double *status)
WITHOUT(fmi2GetIntegerStatus, int kind, int *status)
WITHOUT(fmi2GetBooleanStatus, int kind, Boolean *status)
WITHOUT(fmi2GetStringStatus, int kind, String *status)
EXPORT Status fmi2CancelStep(Component c) { return refuse(c, "fmi2CancelStep is not supported"); }
