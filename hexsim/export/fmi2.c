/* FMI 2.0, co-simulation. All variables are real. */
#include <stdlib.h>

#include "plant.h"

typedef int Boolean;
typedef struct {
  void (*logger)(void *environment, String instance, Status, String category, String message, ...);
  void *(*allocate)(size_t, size_t);
  void (*release)(void *);
  void (*finished)(void *environment, Status);
  void *environment;
} Callbacks;

EXPORT String fmi2GetTypesPlatform(void) { return "default"; }
EXPORT String fmi2GetVersion(void) { return "2.0"; }
EXPORT Status fmi2SetDebugLogging(Instance *c, Boolean on, size_t n, const String categories[]) { return OK; }

static void say(const Instance *c, String text) {
  char plain[512];
  size_t k = 0;
  for (; text[k] && k < sizeof plain - 1; k++) plain[k] = text[k] == '%' ? ' ' : text[k]; /* the logger takes a format, */
  plain[k] = 0;                                                  /* and some importers show it as it is */
  ((__typeof__(((Callbacks *)0)->logger))c->logger)(c->environment, c->name, ERROR, "logStatusError", plain);
}

EXPORT Instance *fmi2Instantiate(String name, int kind, String guid, String resources, const Callbacks *callbacks,
                                 Boolean visible, Boolean logging) {
  void *logger = callbacks ? callbacks->logger : NULL, *environment = callbacks ? callbacks->environment : NULL;
  if (kind == 1) return new_instance(name, guid, say, logger, environment);
  Instance *nobody = calloc(1, sizeof *nobody); /* six compensators of 1.5 MB: too large for a stack */
  if (!nobody) return NULL;
  nobody->say = say, nobody->name = (char *)name, nobody->logger = logger, nobody->environment = environment;
  refuse(nobody, "this FMU is for co-simulation");
  free(nobody);
  return NULL;
}
EXPORT void fmi2FreeInstance(Instance *c) { free_instance(c); }
EXPORT Status fmi2SetupExperiment(Instance *c, Boolean has_tolerance, double tolerance, double t, Boolean has_end, double end) {
  c->now.start_time = t;
  c->has_stop_time = has_end, c->stop_time = end;
  return OK;
}
EXPORT Status fmi2EnterInitializationMode(Instance *c) { return OK; }
EXPORT Status fmi2ExitInitializationMode(Instance *c) { return end_initialisation(c); }
EXPORT Status fmi2Terminate(Instance *c) { return OK; }
EXPORT Status fmi2Reset(Instance *c) {
  c->has_stop_time = 0;
  set_start_values(c);
  return OK;
}
EXPORT Status fmi2GetReal(Instance *c, const Reference r[], size_t n, double values[]) { return get_values(c, r, n, values); }
EXPORT Status fmi2SetReal(Instance *c, const Reference r[], size_t n, const double values[]) { return set_values(c, r, n, values); }
EXPORT Status fmi2DoStep(Instance *c, double t, double h, Boolean no_return_before) { return do_step(c, t, h); }
EXPORT Status fmi2FreeFMUstate(Instance *c, void **state) {
  free(*state);
  *state = NULL;
  return OK;
}
EXPORT Status fmi2GetFMUstate(Instance *c, void **state) { return get_state(c, state); }
EXPORT Status fmi2SetFMUstate(Instance *c, void *state) { return set_state(c, state); }
EXPORT Status fmi2SerializedFMUstateSize(Instance *c, void *state, size_t *size) {
  *size = state_size(c);
  return OK;
}
EXPORT Status fmi2SerializeFMUstate(Instance *c, void *state, char bytes[], size_t size) { return write_state(c, state, bytes, size); }
EXPORT Status fmi2DeSerializeFMUstate(Instance *c, const char bytes[], size_t size, void **state) { return read_state(c, bytes, size, state); }

/* What this FMU does not have: variables that are not real, derivatives, steps in the background. */
#define NONE_OF(name, type) \
  EXPORT Status name(Instance *c, const Reference r[], size_t n, type values[]) { \
    return n ? refuse(c, #name ": all variables are real") : OK; \
  }
NONE_OF(fmi2GetInteger, int) NONE_OF(fmi2GetBoolean, Boolean) NONE_OF(fmi2GetString, String)
NONE_OF(fmi2SetInteger, const int) NONE_OF(fmi2SetBoolean, const Boolean) NONE_OF(fmi2SetString, const String)
#define WITHOUT(name, ...) EXPORT Status name(Instance *c, __VA_ARGS__) { return refuse(c, #name " is not supported"); }
WITHOUT(fmi2GetDirectionalDerivative, const Reference u[], size_t n, const Reference k[], size_t m, const double d[], double r[])
WITHOUT(fmi2SetRealInputDerivatives, const Reference v[], size_t n, const int order[], const double r[])
WITHOUT(fmi2GetRealOutputDerivatives, const Reference v[], size_t n, const int order[], double r[])
WITHOUT(fmi2GetStatus, int kind, Status *status)
WITHOUT(fmi2GetRealStatus, int kind, double *status)
WITHOUT(fmi2GetIntegerStatus, int kind, int *status)
WITHOUT(fmi2GetBooleanStatus, int kind, Boolean *status)
WITHOUT(fmi2GetStringStatus, int kind, String *status)
EXPORT Status fmi2CancelStep(Instance *c) { return refuse(c, "fmi2CancelStep is not supported"); }
