/* An instance as both versions of FMI ask for it. Value references: inputs (volts), outputs, parameters, time. */
#include "plant.h"

#include <stdlib.h>
#include <string.h>

#define STATE_BITS (mjSTATE_INTEGRATION)

void set_start_values(Instance *c) {
  memset(&c->now, 0, sizeof c->now);
  for (int k = 0; k < N_PARAMETERS; k++) c->now.parameters[k] = PARAMETERS[k].start;
  memcpy(c->now.inputs, INPUT_START, sizeof INPUT_START);
  c->is_initialised = c->outputs_hold = false;
}

void free_instance(Instance *c) {
  if (!c) return;
  if (c->data) mj.deleteData(c->data);
  if (c->model) mj.deleteModel(c->model);
  free(c->name);
  free(c);
}

Instance *new_instance(String name, String guid, void (*say)(const Instance *, String), void *logger, void *environment) {
  Instance *c = calloc(1, sizeof *c);
  if (!c) return NULL;
  c->say = say, c->logger = logger, c->environment = environment;
  c->name = calloc(strlen(name) + 1, 1);
  if (c->name) strcpy(c->name, name);
  if (!guid || strcmp(guid, TOKEN)) refuse(c, "guid is %s in place of " TOKEN, guid ? guid : "missing");
  else if (!find_mujoco()) refuse(c, "mujoco.dll beside the FMU's library cannot be loaded: install Microsoft's Visual C++ runtime");
  else {
    *mj.act_dyn = hexsim_act_dyn; /* this MuJoCo is the FMU's own */
    *mj.act_bias = hexsim_act_bias;
    c->model = mj.loadModelBuffer(MODEL, sizeof MODEL);
    c->data = c->model ? mj.makeData(c->model) : NULL;
    if (!c->data) refuse(c, "MuJoCo %s could not load the model: no memory", mj.versionString());
  }
  if (!c->data) {
    free_instance(c);
    return NULL;
  }
  set_start_values(c);
  return c;
}

Status end_initialisation(Instance *c) {
  Status status = c->now.is_started ? OK : start(c);
  c->is_initialised = status == OK;
  return status;
}

Status get_values(Instance *c, const Reference which[], size_t n, double values[]) {
  for (size_t k = 0; k < n; k++) {
    Reference r = which[k];
    if (r > TIME) return refuse(c, "there is no variable with value reference %u", r);
    if (r < FIRST_OUTPUT) values[k] = c->now.inputs[r];
    else if (r == TIME) values[k] = c->now.start_time + c->data->time;
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

Status set_values(Instance *c, const Reference which[], size_t n, const double values[]) {
  for (size_t k = 0; k < n; k++) {
    Reference r = which[k];
    Status status = OK;
    if (r >= TIME || (r >= FIRST_OUTPUT && r < FIRST_PARAMETER))
      status = refuse(c, "value reference %u is no input and no parameter", r);
    else if (r >= FIRST_PARAMETER) status = set_parameter(c, &PARAMETERS[r - FIRST_PARAMETER], values[k]);
    else if (!isfinite(values[k]))
      status = refuse(c, "%s %u %s %g: a finite number is needed", IS_MACHINE ? "setpoint" : "volts of valve", r + 1,
                      IS_MACHINE ? "is" : "are", values[k]);
    else c->now.inputs[r] = values[k];
    if (status != OK) return status;
  }
  return OK;
}

Status do_step(Instance *c, double t, double h) {
  if (!c->is_initialised) return refuse(c, "a step before the initialisation");
  if (c->has_stop_time && t + h > c->stop_time + 1e-6 * h) /* sums of steps round by far less than a millionth of one */
    return refuse(c, "a step from %g to %g s, beyond the stop time of %g s", t, t + h, c->stop_time);
  return advance(c, h);
}

/* State: [size of MuJoCo's part, is_initialised, Numbers, MuJoCo's part], one block. */
#define HEAD (2 + sizeof(Numbers) / sizeof(double))
size_t state_size(const Instance *c) { return sizeof(double) * (HEAD + mj.stateSize(c->model, STATE_BITS)); }

Status get_state(Instance *c, void **state) {
  double *block = *state ? *state : malloc(state_size(c));
  if (!block) return refuse(c, "no memory for a state");
  block[0] = mj.stateSize(c->model, STATE_BITS);
  block[1] = c->is_initialised;
  memcpy(block + 2, &c->now, sizeof c->now);
  mj.getState(c->model, c->data, block + HEAD, STATE_BITS);
  *state = block;
  return OK;
}

Status set_state(Instance *c, const void *state) {
  const double *block = state;
  if (!block || block[0] != mj.stateSize(c->model, STATE_BITS)) return refuse(c, "the state is not one of this FMU");
  memcpy(&c->now, block + 2, sizeof c->now);
  if (c->now.is_started) put_parameters(c);
  mj.setState(c->model, c->data, block + HEAD, STATE_BITS);
  forget_warnings(c);
  c->is_initialised = block[1] != 0;
  c->outputs_hold = false;
  return OK;
}

Status write_state(const Instance *c, const void *state, void *bytes, size_t size) {
  if (size < state_size(c)) return refuse(c, "%zu bytes do not hold a state", size);
  memcpy(bytes, state, state_size(c));
  return OK;
}

Status read_state(const Instance *c, const void *bytes, size_t size, void **state) {
  if (size != state_size(c)) return refuse(c, "%zu bytes are no state of this FMU", size);
  if (!*state) *state = malloc(size);
  if (!*state) return refuse(c, "no memory for a state");
  memcpy(*state, bytes, size);
  return OK;
}
