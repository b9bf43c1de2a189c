/* FMI 3.0, co-simulation. All variables are Float64; without events, clocks and derivatives. */
#include <stdlib.h>

#include "plant.h"

typedef void (*LogMessage)(void *environment, Status, String category, String message);

EXPORT String fmi3GetVersion(void) { return "3.0"; }
EXPORT Status fmi3SetDebugLogging(Instance *c, bool on, size_t n, const String categories[]) { return OK; }

static void say(const Instance *c, String text) { ((LogMessage)c->logger)(c->environment, ERROR, "logStatusError", text); }

EXPORT Instance *fmi3InstantiateCoSimulation(String name, String token, String resources, bool visible, bool logging,
                                             bool event_mode, bool early_return, const Reference required[], size_t n,
                                             void *environment, LogMessage logger, void *intermediate) {
  return new_instance(name, token, say, logger, environment);
}
EXPORT Instance *fmi3InstantiateModelExchange(String name, String token, String resources, bool visible, bool logging,
                                              void *environment, LogMessage logger) {
  if (logger) logger(environment, ERROR, "logStatusError", "this FMU is for co-simulation");
  return NULL;
}
EXPORT Instance *fmi3InstantiateScheduledExecution(String name, String token, String resources, bool visible, bool logging,
                                                   void *environment, LogMessage logger, void *a, void *b, void *d) {
  return fmi3InstantiateModelExchange(name, token, resources, visible, logging, environment, logger);
}
EXPORT void fmi3FreeInstance(Instance *c) { free_instance(c); }
EXPORT Status fmi3EnterInitializationMode(Instance *c, bool has_tolerance, double tolerance, double t, bool has_end, double end) {
  c->now.start_time = t;
  c->has_stop_time = has_end, c->stop_time = end;
  return OK;
}
EXPORT Status fmi3ExitInitializationMode(Instance *c) { return end_initialisation(c); }
EXPORT Status fmi3Terminate(Instance *c) { return OK; }
EXPORT Status fmi3Reset(Instance *c) {
  c->has_stop_time = 0;
  set_start_values(c);
  return OK;
}
EXPORT Status fmi3GetFloat64(Instance *c, const Reference r[], size_t n, double values[], size_t m) {
  return n == m ? get_values(c, r, n, values) : refuse(c, "%zu values for %zu variables, which are scalars", m, n);
}
EXPORT Status fmi3SetFloat64(Instance *c, const Reference r[], size_t n, const double values[], size_t m) {
  return n == m ? set_values(c, r, n, values) : refuse(c, "%zu values for %zu variables, which are scalars", m, n);
}
EXPORT Status fmi3DoStep(Instance *c, double t, double h, bool no_return_before, bool *event, bool *terminate, bool *early,
                         double *last_time) {
  Status status = do_step(c, t, h);
  *event = *terminate = *early = false;
  *last_time = status == OK ? t + h : t;
  return status;
}
EXPORT Status fmi3GetFMUState(Instance *c, void **state) { return get_state(c, state); }
EXPORT Status fmi3SetFMUState(Instance *c, void *state) { return set_state(c, state); }
EXPORT Status fmi3FreeFMUState(Instance *c, void **state) {
  free(*state);
  *state = NULL;
  return OK;
}
EXPORT Status fmi3SerializedFMUStateSize(Instance *c, void *state, size_t *size) {
  *size = state_size(c);
  return OK;
}
EXPORT Status fmi3SerializeFMUState(Instance *c, void *state, unsigned char bytes[], size_t size) { return write_state(c, state, bytes, size); }
EXPORT Status fmi3DeserializeFMUState(Instance *c, const unsigned char bytes[], size_t size, void **state) { return read_state(c, bytes, size, state); }

/* What this FMU does not have: whatever the arguments, it is refused. */
#define WITHOUT(name) EXPORT Status fmi3##name(Instance *c) { return refuse(c, "fmi3" #name " is not supported"); }
#define OF_TYPE(type) WITHOUT(Get##type) WITHOUT(Set##type)
OF_TYPE(Float32) OF_TYPE(Int8) OF_TYPE(UInt8) OF_TYPE(Int16) OF_TYPE(UInt16) OF_TYPE(Int32) OF_TYPE(UInt32) OF_TYPE(Int64)
OF_TYPE(UInt64) OF_TYPE(Boolean) OF_TYPE(String) OF_TYPE(Binary) OF_TYPE(Clock) OF_TYPE(IntervalDecimal)
OF_TYPE(IntervalFraction) OF_TYPE(ShiftDecimal) OF_TYPE(ShiftFraction) OF_TYPE(ContinuousStates)
WITHOUT(GetNumberOfVariableDependencies) WITHOUT(GetVariableDependencies) WITHOUT(GetDirectionalDerivative)
WITHOUT(GetAdjointDerivative) WITHOUT(GetOutputDerivatives) WITHOUT(GetContinuousStateDerivatives) WITHOUT(GetEventIndicators)
WITHOUT(GetNominalsOfContinuousStates) WITHOUT(GetNumberOfEventIndicators) WITHOUT(GetNumberOfContinuousStates)
WITHOUT(EnterEventMode) WITHOUT(EnterConfigurationMode) WITHOUT(ExitConfigurationMode) WITHOUT(EnterContinuousTimeMode)
WITHOUT(EnterStepMode) WITHOUT(EvaluateDiscreteStates) WITHOUT(UpdateDiscreteStates) WITHOUT(CompletedIntegratorStep)
WITHOUT(SetTime) WITHOUT(ActivateModelPartition)
