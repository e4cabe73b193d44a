/*
 * Time that the program itself spends between two calls.
 *
 * If the process has waited for something, that is the time of the wall clock. If not, it has computed, and where
 * another process had the processor meanwhile, only its own time on the processor counts: a busy computer must not make
 * the machine run empty.
 */
#ifndef GAP_H
#define GAP_H

#include "platform.h"

typedef struct {
    double wall_ms, processor_ms;
    long waits; /* how often the process gave up the processor */
} Moment;

#ifdef _WIN32

static Moment moment(void)
{
    return (Moment){.wall_ms = wall_ms()};
}

static double gap_ms(Moment since, int *has_waited)
{
    *has_waited = 0; /* It is not known. */
    return wall_ms() - since.wall_ms;
}

#else

static Moment moment(void)
{
    struct rusage used;
    Moment now = {.wall_ms = wall_ms()};
    if (getrusage(RUSAGE_SELF, &used) == 0) {
        now.waits = used.ru_nvcsw;
        now.processor_ms = (double)(used.ru_utime.tv_sec + used.ru_stime.tv_sec) * 1e3
                           + (double)(used.ru_utime.tv_usec + used.ru_stime.tv_usec) / 1e3;
    }
    return now;
}

/* has_waited: whether it certainly has. */
static double gap_ms(Moment since, int *has_waited)
{
    double gap = wall_ms() - since.wall_ms;
    Moment now;
    *has_waited = 0;
    if (gap < 1)
        return gap;
    now = moment();
    *has_waited = now.waits != since.waits;
    return !*has_waited ? fmin(gap, now.processor_ms - since.processor_ms) : gap;
}

#endif
#endif
