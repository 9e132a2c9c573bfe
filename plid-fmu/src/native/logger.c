/* The logger of FMI 2.0. It writes a message out in full and passes it on, because Rust cannot receive a variable
   number of arguments. */

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

/* The beginning of `Log` in log.rs. */
struct log {
    void (*keep)(const struct log *log, int status, const char *message);
};

void plid_fmu_logger(void *environment, const char *instance, int status, const char *category, const char *message,
                     ...) {
    const struct log *log = environment;
    char short_text[256], *text = short_text;
    int length;
    va_list arguments;
    (void)instance;
    (void)category;
    /* What an FMU says although all is well is not written out. */
    if (log == NULL || message == NULL || status == 0) {
        return;
    }
    va_start(arguments, message);
    length = vsnprintf(short_text, sizeof short_text, message, arguments);
    va_end(arguments);
    if (length >= (int)sizeof short_text && (text = malloc((size_t)length + 1)) != NULL) {
        va_start(arguments, message);
        vsnprintf(text, (size_t)length + 1, message, arguments);
        va_end(arguments);
    }
    log->keep(log, status, length < 0 ? message : text != NULL ? text : short_text);
    if (text != short_text) {
        free(text);
    }
}
