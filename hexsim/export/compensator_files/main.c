/* The compensator in a control loop: one actuator, a sine of 0.05 m at 0.5 Hz, a valve with overlap and lag, friction.

   Prints the bump at reversals without and with it, and the longest and the mean time of a step and of a design.
   cc -O2 main.c hexsim_adaptive.o -lm        seconds of motion and quiet may be given: ./a.out 60 */
#define _POSIX_C_SOURCE 199309L
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "hexsim_adaptive.h"

#define PI 3.14159265358979323846
#define FINE 20 /* steps of the plant a tick */
static const double *S = hexsim_adaptive_settings;

/* Processor time where the system has it, so that other programs do not count. */
static double seconds(void) {
  struct timespec now;
#ifdef CLOCK_THREAD_CPUTIME_ID
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
#else
  timespec_get(&now, TIME_UTC);
#endif
  return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static double setpoint(double t) { return 0.5 * S[HEXSIM_ADAPTIVE_STROKE_M] + fmin(t / 2.0, 1.0) * 0.05 * sin(PI * t); }

/* An actuator, simpler than any real one: orifice, overlap of 45 mV, spool of second order and 60 Hz, Coulomb friction. */
typedef struct { double oil, spool, spool_rate, pressure, position; } Plant;

static void advance(Plant *p, double volts, double tick) {
  const double w = 2.0 * PI * 60.0, supply = 7e6, h = tick / FINE;
  for (int i = 0; i < FINE; i++) {
    p->spool_rate += h * (w * w * (volts - p->spool) - 1.4 * w * p->spool_rate);
    p->spool += h * p->spool_rate;
    double open = fmax(fabs(p->spool) - 0.0454, 0.0), drop = p->spool > 0.0 ? supply - p->pressure : p->pressure;
    double flow = (p->spool > 0.0 ? 0.15 : -0.15) * open * sqrt(fmax(drop, 0.0) / 3.5e6);
    p->oil += h * flow;
    p->pressure = 3.4e6 + 6e4 * tanh(flow / 2e-3) + 2e6 * flow; /* load, friction */
    double stiffness = S[HEXSIM_ADAPTIVE_BULK_MODULUS_PA];
    p->position = p->oil - (p->position + S[HEXSIM_ADAPTIVE_PIPELINE_LENGTH_M]) * p->pressure / stiffness;
  }
}

typedef struct { double longest, total; long count; } Times;

static void note(Times *times, double took) {
  times->longest = fmax(times->longest, took), times->total += took, times->count++;
}

static void print(const char *what, const Times *times) {
  printf("%s: %ld, mean %.2f us, longest %.1f us\n", what, times->count, 1e6 * times->total / fmax(times->count, 1),
         1e6 * times->longest);
}

static double noise(double size) { return size * ((double)rand() / RAND_MAX - 0.5); }

int main(int count, char **arguments) {
  static double state[HEXSIM_ADAPTIVE_STATE_SIZE], parameters[HEXSIM_ADAPTIVE_PARAMETERS];
  double preview[HEXSIM_ADAPTIVE_PREVIEW], tick = S[HEXSIM_ADAPTIVE_TICK_S], valve = 0.0, added = 0.0, worst[2] = {0, 0};
  double duration = count > 1 ? atof(arguments[1]) : 60.0;
  Times step = {0, 0, 0}, design = {0, 0, 0};
  int told = hexsim_adaptive_init(state, S);
  if (told) {
    printf("setting %d is refused\n", told - 1);
    return 1;
  }
  Plant plant = {.oil = setpoint(0.0), .pressure = 3.4e6, .position = setpoint(0.0)};
  for (long k = 0; k * tick < duration; k++) {
    double t = k * tick, position = plant.position + noise(3e-6), bottom = plant.pressure + noise(4e3);
    for (int i = 0; i < HEXSIM_ADAPTIVE_PREVIEW; i++) preview[i] = setpoint(t + i * tick);
    double control = S[HEXSIM_ADAPTIVE_POSITION_GAIN_V_PER_M] * (preview[0] - position);
    double start = seconds();
    told = hexsim_adaptive_step(state, preview[0], preview, HEXSIM_ADAPTIVE_PREVIEW, position, control, 0.0, valve, bottom,
                                0.0, 7e6, &added);
    note(&step, seconds() - start);
    if (told & HEXSIM_ADAPTIVE_DESIGN_WANTED) {
      start = seconds();
      hexsim_adaptive_design(state);
      note(&design, seconds() - start);
    }
    valve = fmax(-S[HEXSIM_ADAPTIVE_VOLTAGE_MAX_V], fmin(S[HEXSIM_ADAPTIVE_VOLTAGE_MAX_V], control + added));
    advance(&plant, valve, tick);
    double error = preview[0] - plant.position;
    if (t > 4.0 && (t < 8.0 || t > duration - 4.0)) worst[t >= 8.0] = fmax(worst[t >= 8.0], fabs(error));
  }
  hexsim_adaptive_get_parameters(state, parameters);
  printf("largest lag: plain control %.3f mm, compensated %.3f mm\n", 1e3 * worst[0], 1e3 * worst[1]);
  printf("dead band found: %.4f V (true: 0.0454), lag of the spool %.2f ms\n",
         parameters[HEXSIM_ADAPTIVE_LEARNED_FLOW_EXTEND_DEAD_BAND_V],
         1e3 * parameters[HEXSIM_ADAPTIVE_LEARNED_FLOW_EXTEND_LAG_S]);
  print("steps", &step);
  print("designs", &design);
  printf("a state: %zu bytes\n", sizeof state);
  return 0;
}
