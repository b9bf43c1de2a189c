/* The hydraulic leg as an actuator plugin of MuJoCo: ctrl = valve volts, act = the leg's states, chambers in MPa.

   The equations are hexsim's, compiled (leg_rates, leg_bias). leg_plugin.h, written at export, has the names of the numbers
   and their places. Every instance has one actuator; its numbers are read once for each mjData and never change. */
#include <mujoco/mujoco.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "leg_plugin.h"

#if defined(_WIN32) || defined(__APPLE__) /* from the MuJoCo that loads this library, whatever it is called */
#ifdef _WIN32
#define WIN32_LEAN_AND_MEAN
#define NOGDI
#include <windows.h>
#else
#include <dlfcn.h>
#include <mach-o/dyld.h>
#endif
#define CALLED(X) X(mj_version) X(mju_warning) X(mj_getPluginConfig) X(mjp_defaultPlugin) X(mjp_registerPlugin)
#define X(name) static __typeof__(&name) found_##name;
CALLED(X)
#undef X
#define mj_version found_mj_version
#define mju_warning found_mju_warning
#define mj_getPluginConfig found_mj_getPluginConfig
#define mjp_defaultPlugin found_mjp_defaultPlugin
#define mjp_registerPlugin found_mjp_registerPlugin
#endif

typedef struct {
  double row[N_ROW];      /* the leg's numbers, SI units */
  double places[N_PLACES]; /* of its states in act; -1: it has no such state */
  int actuator;
} Leg;

void hexsim_leg_rates(const double *row, const double *places, const double *act, double *act_dot, double y, double v,
                      double volts, double t, double h);
double hexsim_leg_bias(const double *row, const double *places, const double *act, double y, double v, double volts, double t);

static int no_states(const mjModel *m, int instance) { return 0; } /* of the plugin: the leg's are in act */

static Leg *leg_of(const mjData *d, int instance) { return (Leg *)(uintptr_t)d->plugin_data[instance]; }

/* Numbers of an attribute into the row from a place on; whether it holds numbers alone, `most` of them or fewer. */
static int read_numbers(const char *text, double *row, int most) {
  int n = 0;
  for (;;) {
    while (*text == ' ' || *text == '\t' || *text == '\n' || *text == '\r') text++;
    if (!*text) return 1;
    char *end;
    double value = strtod(text, &end);
    if (end == text || n == most) return 0;
    row[n++] = value;
    text = end;
  }
}

/* Where the leg's states stand, as `hexsim.plant.states` lays them out; how many there are. */
static int lay_out(Leg *leg, int first) {
  int place = first;
  for (int k = 0; k < N_PLACES; k++) leg->places[k] = -1;
  leg->places[OWNER] = OWNER_LEG;
  if (leg->row[SPOOL_OMEGA] > 0) leg->places[SPOOL] = place, place += 2;
  if (leg->row[BRISTLE_STIFFNESS] > 0) leg->places[BRISTLE] = place++;
  if (leg->row[LEARNED_MEMORY] > 0) leg->places[MEMORY] = place++;
  if (leg->row[ROD_SIDE_CHAMBER] > 0) leg->places[ROD_SIDE] = place++;
  leg->places[PRESSURE] = place++;
  return place - first;
}

static int init(const mjModel *m, mjData *d, int instance) {
  int actuator = -1;
  for (int i = 0; i < m->nu; i++) {
    if (m->actuator_plugin[i] != instance) continue;
    if (actuator >= 0) {
      mju_warning("hexsim.leg: two actuators have one instance; give each an instance of its own");
      return -1;
    }
    actuator = i;
  }
  Leg *leg = calloc(1, sizeof *leg);
  if (!leg) return -1;
  leg->actuator = actuator;
  for (int k = 0; k < N_ATTRIBUTES; k++) {
    const char *text = mj_getPluginConfig(m, instance, ATTRIBUTES[k]);
    if (text && !read_numbers(text, leg->row + FIRST[k], COUNT[k])) {
      mju_warning("hexsim.leg: attribute %s is '%.60s'; it takes up to %d numbers in SI units", ATTRIBUTES[k], text, COUNT[k]);
      free(leg);
      return -1;
    }
  }
  if (actuator >= 0) {
    int states = lay_out(leg, m->actuator_actadr[actuator]);
    if (states != m->actuator_actnum[actuator]) {
      mju_warning("hexsim.leg: actuator %d has actdim %d, its leg has %d states: dyntype=\"user\" actdim=\"%d\"", actuator,
                  m->actuator_actnum[actuator], states, states);
      free(leg);
      return -1;
    }
  }
  d->plugin_data[instance] = (uintptr_t)leg;
  return 0;
}

static void destroy(mjData *d, int instance) {
  free(leg_of(d, instance));
  d->plugin_data[instance] = 0;
}

static void reset(const mjModel *m, mjtNum *state, void *data, int instance) {}

static void rates(const mjModel *m, mjData *d, int instance) {
  const Leg *leg = leg_of(d, instance);
  int i = leg->actuator;
  if (i < 0) return;
  hexsim_leg_rates(leg->row, leg->places, d->act, d->act_dot, d->actuator_length[i] - leg->row[LENGTH_OFFSET],
                   d->actuator_velocity[i], d->ctrl[i], d->time, m->opt.timestep);
}

static void force(const mjModel *m, mjData *d, int instance, int capability) {
  const Leg *leg = leg_of(d, instance);
  int i = leg->actuator;
  if (i < 0) return;
  double pressure = d->act[(int)leg->places[PRESSURE]];
  d->actuator_force[i] = leg->row[AREA_BOTTOM] * 1e6 * pressure +
                         hexsim_leg_bias(leg->row, leg->places, d->act, d->actuator_length[i] - leg->row[LENGTH_OFFSET],
                                         d->actuator_velocity[i], d->ctrl[i], d->time);
}

static void register_leg(void) {
  if (mj_version() != mjVERSION_HEADER) {
    mju_warning("hexsim.leg is made for version %d of MuJoCo, this is %d: export it anew", mjVERSION_HEADER, mj_version());
    return;
  }
  mjpPlugin plugin;
  mjp_defaultPlugin(&plugin);
  plugin.name = "hexsim.leg";
  plugin.nattribute = N_ATTRIBUTES;
  plugin.attributes = ATTRIBUTES;
  plugin.capabilityflags = mjPLUGIN_ACTUATOR;
  plugin.nstate = no_states;
  plugin.init = init;
  plugin.destroy = destroy;
  plugin.reset = reset;
  plugin.compute = force;
  plugin.actuator_act_dot = rates;
  mjp_registerPlugin(&plugin);
}

#ifdef _WIN32
BOOL WINAPI DllMain(HINSTANCE own, DWORD reason, LPVOID reserved) {
  if (reason != DLL_PROCESS_ATTACH) return TRUE;
  HMODULE mujoco = GetModuleHandleA("mujoco.dll");
  if (!mujoco) return FALSE;
#define X(name) \
  if (!(found_##name = (void *)GetProcAddress(mujoco, #name))) return FALSE;
  CALLED(X)
#undef X
  register_leg();
  return TRUE;
}
#elif defined(__APPLE__)
/* The loaded image that has MuJoCo's functions: a dylib, a framework, or a program that is linked with them. */
static void *mujoco_image(void) {
  for (uint32_t i = 0; i < _dyld_image_count(); i++) {
    void *image = dlopen(_dyld_get_image_name(i), RTLD_LAZY | RTLD_NOLOAD);
    if (image && dlsym(image, "mjp_registerPlugin")) return image;
    if (image) dlclose(image);
  }
  return 0;
}

__attribute__((constructor)) static void at_load(void) {
  void *mujoco = mujoco_image();
  if (!mujoco) return;
#define X(name) \
  if (!(found_##name = dlsym(mujoco, #name))) return;
  CALLED(X)
#undef X
  register_leg();
}
#else
__attribute__((constructor)) static void at_load(void) { register_leg(); }
#endif
