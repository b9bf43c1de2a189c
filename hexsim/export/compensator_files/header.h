/* Compensation of valve and friction of one hydraulic actuator: @prefix@. See README.md beside this file.

   All numbers are SI doubles. One state an actuator, owned by the caller, of @STATE@ doubles, aligned to 8 bytes. Nothing
   is allocated, no function blocks, all are safe in several threads for different states. Called at @RATE@ Hz. */
#ifndef @PREFIX@_H
#define @PREFIX@_H
#ifdef __cplusplus
extern "C" {
#endif

#define @PREFIX@_STATE_SIZE @STATE@      /* doubles of a state */
#define @PREFIX@_SETTINGS @SETTINGS@         /* numbers of the data sheet and the configuration */
#define @PREFIX@_PARAMETERS @PARAMETERS@       /* numbers that are learned */
#define @PREFIX@_PREVIEW @PREVIEW@          /* setpoints that the preview should hold: this tick's and the next; 1 if unknown */

/* What a step tells, or-ed. Plain control acts alone with a fault. */
enum {
  @PREFIX@_SIGNAL_LOST = 8,     /* a signal is not a number */
  @PREFIX@_POSITION_FROZEN = 16,
  @PREFIX@_PRESSURE_FROZEN = 32,
  @PREFIX@_VALVE_AT_END = 64,   /* of its range for 5 ticks */
  @PREFIX@_NOT_FINITE = 256,    /* the state is not finite; it starts anew with nothing learned */
  @PREFIX@_BEYOND = 512,        /* more volts than the declared valve can explain; the same */
  @PREFIX@_TELLS = 128          /* no fault: something for the other legs of the machine: @prefix@_hear of each */
};

/* Places in `settings`. */
enum {
  @SETTING_PLACES@
};

/* Of the machine that this was exported for. */
static const double @prefix@_settings[@SETTINGS@] = {
  @SETTING_VALUES@
};

/* Places in `parameters`. */
enum {
  @PARAMETER_PLACES@
};
@LEARNED@
/* Nothing learned. 0, or 1 + the place of the first setting that is not finite, or that must be above zero; then the
   state is as it was. */
int @prefix@_init(double *state, const double *settings);

/* One tick. Gives flags, and into `added_V` the volts to add to control_V. Finite and within the valve's range whatever
   it is given.
   setpoint_m      where the position controller takes the piston, behind a filter that it may have; 0 at full retraction
   preview_m       before that filter: setpoints of this tick and the next (preview_count of them; 1 = no future is known)
   position_m      measured
   control_V       of the position controller at this tick
   feed_forward_V  the part of control_V that it feeds forward from the setpoint; else 0
   valve_V         sent to the valve at the previous tick, added volts included, as it was limited
   bottom_Pa       measured pressure below the piston
   top_Pa          measured pressure of a rod side on a four-way valve; else 0
   supply_Pa       measured supply pressure */
int @prefix@_step(double *state, double setpoint_m, const double *preview_m, int preview_count, double position_m,
                  double control_V, double feed_forward_V, double valve_V, double bottom_Pa, double top_Pa,
                  double supply_Pa, double *added_V);

/* Before a step, for a leg of a platform: the load that the setpoints of all legs give this one at this tick and the next
   (count of them, as of preview_m) [m/s2]: force over the mass that the leg has while all legs move alike. README.md says
   how. Without it a leg expects the load of its own acceleration. It holds for one step. */
void @prefix@_expect(double *state, const double *loads_m_s2, int count);

/* The same of what all legs did 5 ticks ago (count of them, at most 8): forces P1 A1 - P2 A2 [N], speeds by a parabola through 11
   readings [m/s], the acceleration that a force on each gives this leg over that for a force on its own, and the load of this one by
   pose and speeds [m/s2]. README.md says how. */
void @prefix@_feel(double *state, double pose_m_s2, const double *mobility, const double *forces_N, const double *speeds_m_s,
                   int count);

/* After a tick in which the step of `other` gave @PREFIX@_TELLS, when all legs have stepped: what that leg has learned, and how far
   it is with engaging. For legs with equal settings but for those of their place. */
void @prefix@_hear(double *state, const double *other);

/* What was learned: to be kept, and to start with next time. set_parameters starts the state anew. It gives 0, or 1 + the
   place of the first number that is not finite, out of its range, or contradicts another one; then the state is as it was. */
void @prefix@_get_parameters(double *state, double *parameters);
int @prefix@_set_parameters(double *state, const double *parameters);

/* Doubles of a state, of the library that is there: equal to @PREFIX@_STATE_SIZE if header and library belong together. */
int @prefix@_state_size(void);

#ifdef __cplusplus
}
#endif
#endif
