/* The compensator in a control loop: one actuator, a sine of 0.05 m at 0.5 Hz, a valve with overlap and lag, friction.

   Prints the bump at reversals, from one 20 ms to the next, without and with it, and the longest and the mean time of its
   functions.
   cc -O2 main.c @prefix@.o -lm        seconds of motion and quiet may be given: ./a.out 60 */
#define _POSIX_C_SOURCE 199309L
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "@prefix@.h"

#define PI 3.14159265358979323846
#define FINE 20   /* steps of the plant a tick */
#define WITHIN 10 /* ticks whose mean acceleration is compared with that of as many before */
static const double *S = @prefix@_settings;

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

static double setpoint(double t) { return 0.5 * S[@PREFIX@_STROKE_M] + fmin(t / 2.0, 1.0) * 0.05 * sin(PI * t); }

/* An actuator, simpler than any real one: orifice, overlap of 45.4 mV, spool of second order and 60 Hz, oil, a mass, friction. */
typedef struct { double spool, spool_rate, pressure, position, velocity; } Plant;

static void advance(Plant *p, double volts, double tick) {
  const double w = 2.0 * PI * 60.0, supply = 7e6, h = tick / FINE;
  const double below_m2 = 1.2566e-3, rod_side_m2 = 5.498e-4, mass_kg = 43.0, dead_length_m = 4e-4;
  for (int i = 0; i < FINE; i++) {
    p->spool_rate += h * (w * w * (volts - p->spool) - 1.4 * w * p->spool_rate);
    p->spool += h * p->spool_rate;
    double open = fmax(fabs(p->spool) - 0.0454, 0.0), drop = p->spool > 0.0 ? supply - p->pressure : p->pressure;
    double flow = (p->spool > 0.0 ? 0.15 : -0.15) * open * sqrt(fmax(drop, 0.0) / 3.5e6);
    p->pressure += h * S[@PREFIX@_BULK_MODULUS_PA] * (flow - p->velocity) / (p->position + dead_length_m);
    double friction = 75.0 * tanh(p->velocity / 1e-3) + 1500.0 * p->velocity;
    p->velocity += h * ((p->pressure * below_m2 - supply * rod_side_m2 - friction) / mass_kg - 9.81);
    p->position += h * p->velocity;
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
  static double state[@PREFIX@_STATE_SIZE], parameters[@PREFIX@_PARAMETERS];
  double preview[@PREFIX@_PREVIEW], tick = S[@PREFIX@_TICK_S], valve = 0.0, added = 0.0, worst[2] = {0, 0};
  double past[2 * WITHIN] = {0};
  double duration = count > 1 ? atof(arguments[1]) : 60.0;
  Times step = {0, 0, 0};
  double settings[@PREFIX@_SETTINGS];
  memcpy(settings, S, sizeof settings);
  settings[@PREFIX@_LEGS] = 0.0; /* it carries its own mass alone */
  settings[@PREFIX@_OWN_MOBILITY] = settings[@PREFIX@_LOAD_OVER_WEIGHT] = 1.0;
  int told = @prefix@_init(state, settings);
  if (told) {
    printf("setting %d is refused\n", told - 1);
    return 1;
  }
  Plant plant = {.pressure = 3.398e6, .position = setpoint(0.0)}; /* at rest */
  for (long k = 0; k * tick < duration; k++) {
    double t = k * tick, position = plant.position + noise(3e-6), bottom = plant.pressure + noise(4e3);
    for (int i = 0; i < @PREFIX@_PREVIEW; i++) preview[i] = setpoint(t + i * tick);
    double control = S[@PREFIX@_POSITION_GAIN_V_PER_M] * (preview[0] - position);
    double start = seconds();
    told = @prefix@_step(state, preview[0], preview, @PREFIX@_PREVIEW, position, control, 0.0, valve, bottom,
                                0.0, 7e6, &added);
    note(&step, seconds() - start);
    valve = fmax(-S[@PREFIX@_VOLTAGE_MAX_V], fmin(S[@PREFIX@_VOLTAGE_MAX_V], control + added));
    advance(&plant, valve, tick);
    double before = past[(k + WITHIN) % (2 * WITHIN)], older = past[k % (2 * WITHIN)];
    double bump = fabs(plant.velocity - 2.0 * before + older) / (WITHIN * tick);
    past[k % (2 * WITHIN)] = plant.velocity;
    if (t > 1.0 && (t < 3.0 || t > duration - 4.0)) worst[t >= 3.0] = fmax(worst[t >= 3.0], bump);
  }
  @prefix@_get_parameters(state, parameters);
  printf("largest bump: plain control %.3f m/s2, compensated %.3f m/s2\n", worst[0], worst[1]);
  printf("dead band found: %.4f V (true: 0.0454), spool of %.1f Hz (true: 60)\n", parameters[@PREFIX@_LEARNED_NUMBERS_DEAD_UP_V],
         exp(parameters[@PREFIX@_LEARNED_NUMBERS_LN_SPOOL]));
  print("steps", &step);
  printf("a state: %zu bytes\n", sizeof state);
  return 0;
}
