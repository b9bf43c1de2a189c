/* The plant of a machine: MuJoCo's bodies and hexsim's hydraulics, RK4 at a constant step. As `hexsim.plant.Plant`.

   States of chambers are in MPa inside MuJoCo's `act`: pressures, above that of vapour (`hexsim.hydraulics.chamber`). */
#include "plant.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

Status refuse(const Instance *c, const char *format, ...) {
  char text[512];
  va_list values;
  va_start(values, format);
  vsnprintf(text, sizeof text, format, values);
  va_end(values);
  if (c->logger) c->say(c, text);
  return ERROR;
}

void put_parameters(Instance *c) {
  for (int k = 0; k < N_CHANGES; k++) {
    const Change *change = &CHANGES[k];
    double value = c->now.parameters[change->parameter];
    c->model->actuator_user[change->actuator * ROW + change->place] =
        value == PARAMETERS[change->parameter].start ? change->start : change->offset + change->slope * value;
  }
  if (MASS_PARAMETER >= 0) {
    double mass = MASS_OFFSET + c->now.parameters[MASS_PARAMETER];
    if (mass != c->model->body_mass[MASS_BODY]) {
      c->model->body_mass[MASS_BODY] = mass;
      mj.setConst(c->model, c->data);
    }
  }
}

static double declared(const Instance *c, int parameter, double otherwise) {
  return parameter >= 0 ? c->now.parameters[parameter] : otherwise;
}

static const double *layout(const Instance *c, int actuator) { return c->model->actuator_user + actuator * ROW + LAYOUT; }

/* Bottom pressures [Pa] into the state, and the rod sides that rest with them (`Plant.hold_still`). */
static void hold_still(Instance *c, const double *bottom, double supply, double tank) {
  for (int i = 0; i < N_LEGS; i++) {
    const double *places = layout(c, i);
    c->data->act[(int)places[PRESSURE]] = bottom[i] / MPa;
    if (places[ROD_SIDE] >= 0) {
      int on_valve = c->model->actuator_user[i * ROW + ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE;
      c->data->act[(int)places[ROD_SIDE]] = (on_valve ? supply + tank - bottom[i] : supply) / MPa;
    }
  }
}

/* Solve a x = b in place by elimination with row exchange; b becomes x. */
static void solve(double a[N_LEGS][N_LEGS], double *b) {
  for (int k = 0; k < N_LEGS; k++) {
    int pivot = k;
    for (int i = k + 1; i < N_LEGS; i++)
      if (fabs(a[i][k]) > fabs(a[pivot][k])) pivot = i;
    for (int j = 0; j < N_LEGS; j++) {
      double kept = a[k][j];
      a[k][j] = a[pivot][j], a[pivot][j] = kept;
    }
    double kept = b[k];
    b[k] = b[pivot], b[pivot] = kept;
    for (int i = k + 1; i < N_LEGS; i++) {
      double factor = a[i][k] / a[k][k];
      for (int j = k; j < N_LEGS; j++) a[i][j] -= factor * a[k][j];
      b[i] -= factor * b[k];
    }
  }
  for (int k = N_LEGS - 1; k >= 0; k--) {
    for (int j = k + 1; j < N_LEGS; j++) b[k] -= a[k][j] * b[j];
    b[k] /= a[k][k];
  }
}

/* Largest eigenvalue of A diag(k), A symmetric, k >= 0, by Jacobi's rotations; not below 0. */
static double fastest(double a[N_LEGS][N_LEGS], double k[N_LEGS][N_STIFF], int which) {
  double m[N_LEGS][N_LEGS], largest = 0;
  for (int i = 0; i < N_LEGS; i++)
    for (int j = 0; j < N_LEGS; j++) m[i][j] = sqrt(fmax(k[i][which], 0)) * a[i][j] * sqrt(fmax(k[j][which], 0));
  for (int sweep = 0; sweep < 20; sweep++)
    for (int p = 0; p < N_LEGS; p++)
      for (int q = p + 1; q < N_LEGS; q++) {
        if (m[p][q] == 0) continue;
        double half = (m[q][q] - m[p][p]) / (2 * m[p][q]);
        double tangent = copysign(1 / (fabs(half) + hypot(half, 1)), half), cosine = 1 / hypot(tangent, 1);
        for (int j = 0; j < N_LEGS; j++) {
          double x = m[p][j], y = m[q][j];
          m[p][j] = cosine * (x - tangent * y), m[q][j] = cosine * (y + tangent * x);
        }
        for (int j = 0; j < N_LEGS; j++) {
          double x = m[j][p], y = m[j][q];
          m[j][p] = cosine * (x - tangent * y), m[j][q] = cosine * (y + tangent * x);
        }
      }
  for (int i = 0; i < N_LEGS; i++) largest = fmax(largest, m[i][i]);
  return largest;
}

/* What the machine asks of the time step (`Plant.step_rule`), from the platform's accelerations for a pressure in each leg. */
static void find_rule(Instance *c, double slopes[N_LEGS][N_LEGS]) {
  double compliance[N_LEGS][N_LEGS] = {{0}}, stiff[N_LEGS][N_STIFF], rates[N_STIFF + 1] = {0};
  for (int j = 0; j < N_LEGS; j++) {
    const double *row = c->model->actuator_user + j * ROW;
    int on_valve = row[ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE;
    double area = row[AREA_BOTTOM] + (on_valve ? row[AREA_TOP] : 0), own = hexsim_stiffness(row, stiff[j]);
    rates[N_STIFF] = fmax(rates[N_STIFF], fmax(own, LOAD_FREQUENCY));
    for (int i = 0; i < N_LEGS; i++)
      for (int k = 0; k < N_LEGS; k++) compliance[i][j] += ALONG[i * N_LEGS + k] * slopes[k][j] / area;
  }
  for (int i = 0; i < N_LEGS; i++)
    for (int j = i + 1; j < N_LEGS; j++) compliance[i][j] = compliance[j][i] = 0.5 * (compliance[i][j] + compliance[j][i]);
  for (int k = 0; k < N_STIFF; k++) rates[k] = fastest(compliance, stiff, k);
  hexsim_rule(rates, N_ACTUATORS > N_LEGS ? c->model->actuator_user + N_LEGS * ROW : SUPPLY_ROW, c->now.rule);
}

void forget_warnings(Instance *c) {
  for (int k = 0; k < mjNWARNING; k++) c->data->warning[k].number = 1; /* MuJoCo writes the first of a kind into a file */
}

/* Bottom pressures in static equilibrium into the state (`Plant.static_pressures`). */
static Status find_equilibrium(Instance *c) {
  double supply = declared(c, SUPPLY_PARAMETER, SUPPLY_PRESSURE), tank = declared(c, TANK_PARAMETER, TANK_PRESSURE);
  double before[N_LEGS], pressures[N_LEGS], correction[N_LEGS], slopes[N_LEGS][N_LEGS], step = 1e5;
  if (N_ACTUATORS > N_LEGS) c->data->act[(int)layout(c, N_ACTUATORS - 1)[PRESSURE]] = supply / MPa;
  for (int i = 0; i < N_LEGS; i++) before[i] = c->data->act[(int)layout(c, i)[PRESSURE]] * MPa;
  for (int k = -1; k < N_LEGS; k++) {
    for (int i = 0; i < N_LEGS; i++) pressures[i] = before[i] + (i == k ? step : 0);
    hold_still(c, pressures, supply, tank);
    mj.forward(c->model, c->data);
    for (int i = 0; i < N_LEGS; i++) {
      if (k < 0) correction[i] = c->data->qacc[i];
      else slopes[i][k] = (c->data->qacc[i] - correction[i]) / step;
    }
  }
  find_rule(c, slopes);
  solve(slopes, correction);
  for (int i = 0; i < N_LEGS; i++) {
    pressures[i] = before[i] - correction[i];
    if (!(pressures[i] > tank && pressures[i] < supply))
      return refuse(c, "leg %d needs %.1f bar to hold the load at rest, outside %.1f..%.1f bar: lower the mass or raise "
                    "the supply", i + 1, pressures[i] / 1e5, tank / 1e5, supply / 1e5);
  }
  hold_still(c, pressures, supply, tank);
  return OK;
}

Status start(Instance *c) {
  int is_declared = 1;
  for (int k = 0; k < N_PARAMETERS; k++) is_declared &= c->now.parameters[k] == PARAMETERS[k].start;
  put_parameters(c);
  mj.resetData(c->model, c->data);
  forget_warnings(c);
  memcpy(c->data->act, START_ACT, sizeof START_ACT);
  memcpy(c->data->ctrl, START_CTRL, sizeof START_CTRL);
  memcpy(c->now.rule, START_RULE, sizeof START_RULE);
  if (!is_declared && find_equilibrium(c) != OK) return ERROR;
  mj.forward(c->model, c->data);
  memset(c->now.spool_volts, 0, sizeof c->now.spool_volts);
  memset(c->now.apart, 0, sizeof c->now.apart);
  memset(c->now.velocity_before, 0, sizeof c->now.velocity_before);
  memset(c->now.volts, 0, sizeof c->now.volts);
  memset(c->now.commanded, 0, sizeof c->now.commanded);
#if IS_MACHINE
  for (int i = 0; i < N_LEGS; i++) COMPENSATOR(init)(c->now.compensators[i], COMPENSATOR_SETTINGS + i * N_SETTINGS);
#endif
  c->now.commands = c->now.calm_s[0] = 0;
  c->now.is_started = 1;
  c->outputs_hold = false;
  return OK;
}

static int is_finite(const Instance *c) {
  for (int k = 0; k < c->model->nq; k++)
    if (!isfinite(c->data->qpos[k])) return 0;
  for (int k = 0; k < c->model->na; k++)
    if (!isfinite(c->data->act[k])) return 0;
  for (int k = 0; k < mjNWARNING; k++)
    if (c->data->warning[k].number > 1) return 0;
  return 1;
}

/* Note the present command, where it is another one than the last. */
static Status note_command(Instance *c) {
  Numbers *now = &c->now;
  int last = (int)fmod(now->commands + RING - 1, RING), next = (int)fmod(now->commands, RING);
  if (now->commands > 0 && !memcmp(now->past[last], now->volts, sizeof now->volts)) return OK;
  if (now->commands >= RING && now->since[(next + 1) % RING] > c->data->time - LONGEST_DELAY)
    return refuse(c, "more than %d commands within the valve's delay of %g s: take longer communication steps", RING - 1,
                  LONGEST_DELAY);
  memcpy(now->past[next], now->volts, sizeof now->volts);
  now->since[next] = c->data->time;
  now->commands += 1;
  return OK;
}

/* Volts of a leg at a time: of the first command, before it. */
static double command(const Instance *c, int leg, double time) {
  const Numbers *now = &c->now;
  double k = now->commands - 1, oldest = fmax(now->commands - RING, 0);
  while (k > oldest && now->since[(int)fmod(k, RING)] > time) k--;
  return now->past[(int)fmod(k, RING)][leg];
}

/* One span without an end of a delay inside, at most `steps.LONGEST_S` long (`stepping.advance`). */
static void advance_part(Instance *c, double span) {
  Numbers *now = &c->now;
  const mjData *d = c->data;
  for (int i = 0; i < N_LEGS; i++) {
    double volts = command(c, i, d->time - DELAY[i] + 0.5 * span);
    hexsim_hysteresis(volts, &now->spool_volts[i], &now->apart[i], HYSTERESIS[i], SPREAD[i]);
    c->data->ctrl[i] = now->spool_volts[i];
  }
  mj.forward(c->model, c->data);
  mj.checkAcc(c->model, c->data);
  double steps = TIMESTEP > 0 ? 1 : hexsim_choose(c->model->actuator_user, d->act, d->ctrl, d->actuator_length,
                                                  d->actuator_velocity, now->velocity_before, now->calm_s, now->rule,
                                                  &c->model->opt.timestep, d->time, span);
  mj.RungeKutta(c->model, c->data, 4);
  for (int k = 1; k < steps; k++) mj.step(c->model, c->data);
}

static double pose(const Instance *c, int axis) {
  const double *q = c->data->qpos + 3, w = q[0], x = q[1], y = q[2], z = q[3];
  switch (axis) {
    case 0: case 1: return c->data->qpos[axis];
    case 2: return c->data->qpos[2] - NEUTRAL_HEIGHT;
    case 3: return atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y));
    case 4: return asin(fmax(-1, fmin(1, 2 * (w * y - z * x))));
    default: return atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z));
  }
}

static double pressure(double state) { return fmax(state * MPa, VAPOUR); }

static double output(const Instance *c, OutputKind kind, int i) {
  const double *act = c->data->act, *places = layout(c, kind == POSE ? 0 : i % N_LEGS);
  const double *turn = c->data->xmat + 9 * MASS_BODY, *qacc = c->data->qacc;
  switch (kind) {
    case POSITION: return c->data->actuator_length[i] - c->model->actuator_user[i * ROW + LENGTH_OFFSET];
    case VELOCITY: return c->data->actuator_velocity[i];
    case BOTTOM: return pressure(act[(int)places[PRESSURE]]);
    case TOP: return pressure(act[(int)places[ROD_SIDE]]);
    case SUPPLY: return places[SUPPLY_PLACE] >= 0 ? pressure(act[(int)places[SUPPLY_PLACE]])
                                                  : c->model->actuator_user[ROW_SUPPLY_PRESSURE];
    case POSE: return pose(c, i);
    case VALVE: return c->now.volts[i];
    case SETPOINT: return c->now.setpoints[i];
    case ACCELERATION: return N_LEGS == 1 ? qacc[0] : turn[i] * qacc[0] + turn[3 + i] * qacc[1] + turn[6 + i] * qacc[2];
    default: return qacc[3 + i]; /* ANGULAR_ACCELERATION; MuJoCo gives a free joint's in the body's frame */
  }
}

/* Outputs of the present state. The evaluation leaves no trace in the solver's next start. */
void evaluate(Instance *c) {
  double warm[N_VELOCITIES];
  memcpy(warm, c->data->qacc_warmstart, sizeof warm);
  mj.forward(c->model, c->data);
  memcpy(c->data->qacc_warmstart, warm, sizeof warm);
  for (int k = 0; k < N_OUTPUTS; k++) c->outputs[k] = output(c, OUTPUTS[k].kind, OUTPUTS[k].index);
  c->outputs_hold = true;
}

/* By `span` under the present volts: in constant steps, or in an even number of parts with chosen ones. */
static Status hold(Instance *c, double span) {
  double parts = TIMESTEP > 0         ? round(span / TIMESTEP)
                 : span < 1.001 * LONGEST_PART ? 1
                                      : 2 * ceil(span / LONGEST_PART / 2 - 1e-6);
  if (!(span > 0 && parts >= 1 && (TIMESTEP <= 0 || fabs(span / TIMESTEP - parts) < 1e-6 * parts)))
    return refuse(c, TIMESTEP > 0 ? "communication step %g s is not a whole multiple of the time step %g s"
                                  : "a communication step of %g s: above 0 is possible", span, TIMESTEP);
  if (note_command(c) != OK) return ERROR;
  for (double k = 0; k < parts; k++) advance_part(c, TIMESTEP > 0 ? TIMESTEP : span / parts);
  c->outputs_hold = false;
  return OK;
}

#if IS_MACHINE
/* One tick of the motion computer: from the present positions and pressures to volts. The future is not known. */
static void control(Instance *c) {
  Numbers *now = &c->now;
  double position[N_LEGS], bottom[N_LEGS], top[N_LEGS], path[2 * N_LEGS], forward[N_LEGS], asked[N_LEGS], supply, added;
  int tells[N_LEGS] = {0};
  if (!c->outputs_hold) evaluate(c);
  for (int i = 0; i < N_LEGS; i++) {
    position[i] = output(c, POSITION, i);
    bottom[i] = output(c, BOTTOM, i);
    top[i] = layout(c, i)[ROD_SIDE] >= 0 ? output(c, TOP, i) : 0;
  }
  supply = output(c, SUPPLY, 0);
  hexsim_control(now->inputs, position, bottom, top, &supply, now->memory, now->setpoints, path, forward, asked,
                 now->commands == 0);
#if N_SEEN
  double mobility[N_LEGS * N_LEGS], load[N_LEGS], force[N_LEGS], speed[N_LEGS];
  hexsim_watch_legs(position, bottom, top, &supply, now->seen, mobility, load, force, speed, now->commands == 0);
#endif
  for (int i = 0; i < N_LEGS && now->parameters[COMPENSATOR_PARAMETER] > 0; i++) {
#if N_SEEN
    COMPENSATOR(feel)(now->compensators[i], load[i], mobility + i * N_LEGS, force, speed, N_LEGS);
#endif
    int told = COMPENSATOR(step)(now->compensators[i], path[i], path + N_LEGS + i, 1, position[i], asked[i], forward[i],
                                 now->commanded[i], bottom[i], top[i], supply, &added);
    tells[i] = told & TELLS;
    asked[i] += added;
  }
  for (int i = 0; i < N_LEGS; i++) /* legs that are alike learn from each other */
    for (int j = 0; j < N_LEGS && tells[i]; j++)
      if (j != i && ALIKE[i * N_LEGS + j]) COMPENSATOR(hear)(now->compensators[j], now->compensators[i]);
  hexsim_command(now->memory, asked, now->commanded, now->volts);
}

Status advance(Instance *c, double span) {
  double ticks = round(span / TICK);
  if (!(ticks >= 1 && fabs(span / TICK - ticks) < 1e-6 * ticks))
    return refuse(c, "communication step %g s is not a whole multiple of the motion computer's tick of %g s", span, TICK);
  for (double k = 0; k < ticks; k++) {
    control(c);
    if (hold(c, TICK) != OK) return ERROR;
  }
#else
Status advance(Instance *c, double span) {
  memcpy(c->now.volts, c->now.inputs, sizeof c->now.volts);
  if (hold(c, span) != OK) return ERROR;
#endif
  if (is_finite(c)) return OK;
  return refuse(c, "the state left the finite numbers before %g s: the motion is beyond the machine",
                c->now.start_time + c->data->time);
}

/* Error paths of the compiled hydraulics that are never taken. */
#define STUB(name) void name(void) { abort(); }
STUBS
