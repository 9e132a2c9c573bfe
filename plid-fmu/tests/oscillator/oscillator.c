/* A mass on a spring and a damper, as an FMU: FMI=2 or FMI=3 chooses the standard.

   The parameter `fault` makes it fail as FMUs do, once a tenth of a second has passed:
   1 NaN, 2 error, 3 discard, 4 abort, 5 hang, 6 fatal; and at a reset: 7 error, 8 nothing is restored. */

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { OK, WARNING, DISCARD, ERROR, FATAL };
enum { TIME, FORCE, PUSH, POSITION, VELOCITY, FEEDTHROUGH, MASS, STIFFNESS, DAMPING, START, FAULT, COUNT };

#if FMI == 2
typedef void (*logger)(void *, const char *, int, const char *, const char *, ...);
struct callbacks {
    logger log;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void *finished, *environment;
};
#else
typedef void (*logger)(void *, int, const char *, const char *);
#endif

struct instance {
    logger log;
    void *environment;
    double values[COUNT];
};

static void restore(struct instance *of) {
    memset(of->values, 0, sizeof of->values);
    of->values[MASS] = 2.0;
    of->values[STIFFNESS] = 800.0;
    of->values[DAMPING] = 4.0;
}

static void say(struct instance *of, int status, double time) {
#if FMI == 2
    of->log(of->environment, "oscillator", status, "logStatusError", "%s at %.2f s, %d of %d", "the spring broke", time,
            1, 2);
#else
    char text[100];
    snprintf(text, sizeof text, "the spring broke at %.2f s, 1 of 2", time);
    of->log(of->environment, status, "logStatusError", text);
#endif
}

static struct instance *create(logger log, void *environment) {
    struct instance *of = calloc(1, sizeof *of);
    of->log = log;
    of->environment = environment;
    restore(of);
    return of;
}

static int initialise(struct instance *of) {
    of->values[POSITION] = of->values[START];
    return OK;
}

static int reset(struct instance *of) {
    double fault = of->values[FAULT];
    if (fault == 7.0) {
        return ERROR;
    }
    if (fault == 8.0) {
        double position = of->values[POSITION];
        restore(of);
        of->values[VELOCITY] = position + 1.0;
        return OK;
    }
    restore(of);
    return OK;
}

/* A state is a copy of all numbers. */
static int get_state(const struct instance *of, void **state) {
    if (*state == NULL) {
        *state = malloc(sizeof of->values);
    }
    memcpy(*state, of->values, sizeof of->values);
    return OK;
}

static int set_state(struct instance *of, const void *state) {
    memcpy(of->values, state, sizeof of->values);
    return OK;
}

static int free_state(void **state) {
    free(*state);
    *state = NULL;
    return OK;
}

static int set(struct instance *of, const uint32_t *references, size_t count, const double *values) {
    for (size_t k = 0; k < count; k++) {
        if (references[k] >= COUNT) {
            return ERROR;
        }
        of->values[references[k]] = values[k];
    }
    return OK;
}

static int get(struct instance *of, const uint32_t *references, size_t count, double *values) {
    of->values[FEEDTHROUGH] = 10.0 * of->values[FORCE];
    for (size_t k = 0; k < count; k++) {
        if (references[k] >= COUNT) {
            return ERROR;
        }
        values[k] = of->values[references[k]];
    }
    return OK;
}

static double acceleration(const double *v, double x, double speed) {
    return (v[FORCE] + v[PUSH] - v[STIFFNESS] * x - v[DAMPING] * speed) / v[MASS];
}

/* Runge and Kutta's steps of a tenth of a millisecond at most. */
static void integrate(double *v, double step) {
    int count = (int)(step / 1e-4) + 1;
    double h = step / count;
    for (int k = 0; k < count; k++) {
        double x = v[POSITION], s = v[VELOCITY];
        double a1 = acceleration(v, x, s);
        double s2 = s + 0.5 * h * a1, a2 = acceleration(v, x + 0.5 * h * s, s2);
        double s3 = s + 0.5 * h * a2, a3 = acceleration(v, x + 0.5 * h * s2, s3);
        double s4 = s + h * a3, a4 = acceleration(v, x + h * s3, s4);
        v[POSITION] = x + h * (s + 2.0 * s2 + 2.0 * s3 + s4) / 6.0;
        v[VELOCITY] = s + h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0;
    }
}

static int advance(struct instance *of, double time, double step) {
    int fault = (int)of->values[FAULT];
    if (time < of->values[TIME] - 1e-9) {
        return ERROR;
    }
    integrate(of->values, step);
    of->values[TIME] = time + step;
    if (time < 0.1) {
        return OK;
    }
    switch (fault) {
    case 1:
        of->values[POSITION] = 0.0 / (time - time);
        return OK;
    case 2:
        say(of, ERROR, time);
        return ERROR;
    case 3:
        say(of, DISCARD, time);
        return DISCARD;
    case 4:
        puts("lost among the numbers");
        fflush(stdout);
        abort();
    case 5:
        for (;;) {
        }
    case 6:
        say(of, FATAL, time);
        return FATAL;
    }
    return OK;
}

#if FMI == 2
void *fmi2Instantiate(const char *name, int kind, const char *guid, const char *resources,
                      const struct callbacks *callbacks, int visible, int logging) {
    (void)name, (void)visible, (void)logging;
    if (kind != 1 || strcmp(guid, "{oscillator}") != 0 || strncmp(resources, "file:///", 8) != 0) {
        callbacks->log(callbacks->environment, name, ERROR, "logStatusError", "no GUID of this FMU: %s", guid);
        return NULL;
    }
    return create(callbacks->log, callbacks->environment);
}
int fmi2SetDebugLogging(void *of, int on, size_t count, const char *const *categories) {
    (void)of, (void)on, (void)count, (void)categories;
    return OK;
}
int fmi2SetupExperiment(void *of, int has_tolerance, double tolerance, double start, int has_stop, double stop) {
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    ((struct instance *)of)->values[TIME] = start;
    return OK;
}
int fmi2EnterInitializationMode(void *of) { return initialise(of); }
int fmi2ExitInitializationMode(void *of) { (void)of; return OK; }
int fmi2Terminate(void *of) { (void)of; return OK; }
int fmi2Reset(void *of) { return reset(of); }
void fmi2FreeInstance(void *of) { free(of); }
int fmi2GetFMUstate(void *of, void **state) { return get_state(of, state); }
int fmi2SetFMUstate(void *of, void *state) { return set_state(of, state); }
int fmi2FreeFMUstate(void *of, void **state) { (void)of; return free_state(state); }
int fmi2SetReal(void *of, const uint32_t *references, size_t count, const double *values) {
    return set(of, references, count, values);
}
int fmi2GetReal(void *of, const uint32_t *references, size_t count, double *values) {
    return get(of, references, count, values);
}
int fmi2DoStep(void *of, double time, double step, int no_way_back) {
    (void)no_way_back;
    return advance(of, time, step);
}
#else
void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                  bool logging, bool events, bool early, const uint32_t *required, size_t count,
                                  void *environment, logger log, void *update) {
    (void)name, (void)visible, (void)logging, (void)required, (void)update;
    if (strcmp(token, "{oscillator}") != 0 || resources[0] == 'f' || events || early || count != 0) {
        log(environment, ERROR, "logStatusError", "no GUID of this FMU");
        return NULL;
    }
    return create(log, environment);
}
int fmi3SetDebugLogging(void *of, bool on, size_t count, const char *const *categories) {
    (void)of, (void)on, (void)count, (void)categories;
    return OK;
}
int fmi3EnterInitializationMode(void *of, bool has_tolerance, double tolerance, double start, bool has_stop,
                                double stop) {
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    ((struct instance *)of)->values[TIME] = start;
    return initialise(of);
}
int fmi3ExitInitializationMode(void *of) { (void)of; return OK; }
int fmi3Terminate(void *of) { (void)of; return OK; }
int fmi3Reset(void *of) { return reset(of); }
void fmi3FreeInstance(void *of) { free(of); }
int fmi3GetFMUState(void *of, void **state) { return get_state(of, state); }
int fmi3SetFMUState(void *of, void *state) { return set_state(of, state); }
int fmi3FreeFMUState(void *of, void **state) { (void)of; return free_state(state); }
int fmi3SetFloat64(void *of, const uint32_t *references, size_t count, const double *values, size_t numbers) {
    return count == numbers ? set(of, references, count, values) : ERROR;
}
int fmi3GetFloat64(void *of, const uint32_t *references, size_t count, double *values, size_t numbers) {
    return count == numbers ? get(of, references, count, values) : ERROR;
}
int fmi3DoStep(void *of, double time, double step, bool no_way_back, bool *event, bool *ended, bool *early,
               double *reached) {
    (void)no_way_back;
    *event = *ended = *early = false;
    *reached = time + step;
    return advance(of, time, step);
}
#endif
