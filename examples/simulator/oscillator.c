/* A mass on a spring and a damper, as a simulator for plid, in C99: `cc -std=c99 -O2 -o oscillator oscillator.c`, then
 * `plid gap check-simulator -- ./oscillator`. It sends doubles as they are in memory, so the machine must be little
 * endian. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { STEPS = 10 };
static double stiffness, damping, x, v;

static void step(double force) {
    const double h = 1e-3, mass = 2.0;
    v += h * (force - damping * v - stiffness * x) / mass;
    x += h * v;
}

static void take(double *numbers, size_t count) {
    if (fread(numbers, sizeof *numbers, count, stdin) != count) exit(1); /* plid ended within a request */
}

/* Goes to rest with the parameters of a request. Returns 0 if it has not two of them. */
static int start(const char *request) {
    const char *list = strstr(request, "\"parameters\"");
    x = v = 0.0;
    return list && (list = strchr(list, '[')) && sscanf(list, "[%lf,%lf]", &stiffness, &damping) == 2;
}

int main(void) {
    char request[4096];
    puts("{\"protocol\": 1, \"name\": \"oscillator\", \"rate_hz\": 100.0, \"steps_per_sample\": 10,"
         " \"inputs\": [{\"name\": \"force\", \"unit\": \"N\"}],"
         " \"outputs\": [{\"name\": \"position\", \"kind\": \"position\", \"unit\": \"m\"}],"
         " \"ports\": [{\"name\": \"spring\", \"input\": \"force\"}],"
         " \"parameters\": [{\"name\": \"stiffness\", \"value\": 800.0, \"lower\": 0.0},"
         " {\"name\": \"damping\", \"value\": 4.0, \"lower\": 0.0}]}");
    fflush(stdout);
    for (int first; (first = getchar()) != EOF; fflush(stdout)) {
        if (first == 's') {
            double in[2], out[3] = {x};
            take(in, 2);
            step(in[0] + in[1]);
            out[1] = x, out[2] = v;
            putchar('s');
            fwrite(out, sizeof *out, 3, stdout);
            continue;
        }
        if (!fgets(request, sizeof request, stdin)) return 1;
        const char *count = strstr(request, "\"samples\"");
        size_t samples = count ? strtoul(strchr(count, ':') + 1, NULL, 10) : 0;
        double *u = malloc((samples + 1) * sizeof *u);
        if (!u) return 1;
        take(u, samples); /* all inputs, before anything is written */
        if (!start(request)) {
            puts("{\"error\": \"expected two parameters\"}");
        } else {
            puts("{\"ok\": true}");
            if (!count) { /* a start */
                const double rest[2] = {x, v};
                fwrite(rest, sizeof *rest, 2, stdout);
            }
            for (size_t k = 0; k < samples; k++) {
                fwrite(&x, sizeof x, 1, stdout);
                for (int i = 0; i < STEPS; i++) step(u[k]);
            }
        }
        free(u);
    }
    return 0;
}
