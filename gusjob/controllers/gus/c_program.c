/*
 * Compile this file with the vendor's header and library, for example
 *     cc -std=c99 -I FOLDER_OF_THE_HEADER FILE.c -o FILE -lgts
 *     cl FILE.c gts.lib
 * Macros: GUSJOB_HEADER, the vendor's header ("gts.h"); GUSJOB_OPEN, the call that opens the controller (GT_Open(0, 1));
 * GUSJOB_PATIENCE_S and GUSJOB_START_S, whole seconds, see below. GUSJOB_NO_MAIN leaves main() out, for use in another
 * program, which opens the controller, sets it up, switches the axes on and calls gusjob_run().
 *
 * Run it as FILE [CONFIGURATION], the file for GT_LoadConfig. Exit status: 0 done, 1 refused or failed, 2 stopped by
 * Ctrl+C or another signal. Errors are written to stderr with the line of the job.
 *
 * The program makes the calls in the job's order and checks every return value.
 * - FIFO full: it waits for space and sends the same call again. If the stage is longer than the FIFO, it sends
 *   GT_CrdStart then, and not again at the end of the stage.
 * - A call that is refused although there was space, motion that stops with calls still queued (the FIFO ran dry, or
 *   something stopped the axes), or no progress for GUSJOB_PATIENCE_S seconds is an error.
 * - Shutdown after an error or a stop: laser off, GT_Stop, laser off again when the motion has stopped, the message,
 *   GT_Close.
 * A process that is killed or crashes, or that has lost its link, cannot switch the laser off: that takes an interlock
 * in hardware.
 */
#if !defined(_WIN32) && !defined(_POSIX_C_SOURCE)
#define _POSIX_C_SOURCE 200809L
#endif
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#ifdef _WIN32
#ifndef WIN32_LEAN_AND_MEAN
#define WIN32_LEAN_AND_MEAN
#endif
#include <windows.h>
#endif

#ifndef GUSJOB_HEADER
#define GUSJOB_HEADER "gts.h"
#endif
#include GUSJOB_HEADER

#ifndef GUSJOB_OPEN
#define GUSJOB_OPEN GT_Open(0, 1)
#endif
#ifndef GUSJOB_PATIENCE_S
#define GUSJOB_PATIENCE_S 30 /* The longest time without progress is a GT_BufDelay, 16.4 s. */
#endif
#ifndef GUSJOB_START_S
#define GUSJOB_START_S 1 /* How long after GT_CrdStart the motion may take to start. */
#endif

enum { GUSJOB_DONE = 0, GUSJOB_REFUSED = 1, GUSJOB_STOPPED = 2 };

/* Run the job on an opened controller; return one of the above, with the lasers off. */
int gusjob_run(void);

/* Set it to stop the job, also from a signal handler. */
extern volatile sig_atomic_t gusjob_stop;
volatile sig_atomic_t gusjob_stop = 0;

enum {
    LnXY, LnXYG0, ArcXYC, ArcXYR, BufDelay, BufLaserOn, BufLaserOff, BufLaserPrfCmd, BufLaserPrfFollow,
    BufLaserFollowRatio, BufLaserFollowOff, BufLaserFollowMode
};
static const char *const NAMES[] = {
    "LnXY", "LnXYG0", "ArcXYC", "ArcXYR", "BufDelay", "BufLaserOn", "BufLaserOff", "BufLaserPrfCmd",
    "BufLaserPrfFollow", "BufLaserFollowRatio", "BufLaserFollowOff", "BufLaserFollowMode"};
static const int ARGUMENTS[] = {7, 6, 10, 9, 3, 3, 3, 4, 6, 6, 3, 5};
static const int FIFO_AT[] = {6, 5, 9, 8, 2, 1, 1, 2, 4, 4, 1, 2};

/* A buffered call: line of the job, number of the call, arguments in the vendor's order. */
typedef struct {
    int line;
    int call;
    double a[GUSJOB_ARGUMENTS];
} Row;

/* What the job uses; each list ends with -1. */
static const short CHANNELS[] = {GUSJOB_CHANNELS};
static const short CRDS[] = {GUSJOB_CRDS};
static const short AXES[] = {GUSJOB_AXES};

/* A coordinate system. started: between GT_CrdStart and the end of the motion. early: started because the FIFO was full
   before the stage was complete. ran: it has been seen running. */
typedef struct {
    short fifo;
    long size;
    int line;
    int started;
    int early;
    int ran;
} Crd;
#define FIFO_SLOTS 4096
static Crd crds[3];

/* Progress of the motion. */
typedef struct {
    short run;
    long segment;
    long space;
    double position[8];
} Progress;

/* Messages are kept until the lasers are off and the motion has stopped: writing to a terminal or a pipe may block. */
static char messages[2000];

static void report(const char *format, ...)
{
    size_t used = strlen(messages);
    va_list values;
    va_start(values, format);
    vsnprintf(messages + used, sizeof messages - used, format, values);
    va_end(values);
}

static void report_line(int line)
{
    if (line > 0)
        report("line %d: ", line);
}

/* Return codes of the sister series. */
static const char *meaning(short code)
{
    switch (code) {
    case 1:
        return "can't be done now (FIFO full, coordinate system moving)";
    case 2:
        return "no licence";
    case 3:
        return "wrong version";
    case 7:
        return "parameter error";
    case 8:
        return "not supported by the firmware";
    case -1:
    case -2:
    case -3:
    case -4:
    case -5:
        return "fault of the link to the controller";
    case -6:
        return "the controller can't be opened";
    case -7:
        return "no response";
    case -8:
        return "lock time-out";
    default:
        return "not documented";
    }
}

/* Whether a call succeeded; report it if not. Every step returns 1 to continue and 0 to shut down. */
static int succeeded(short code, int line, const char *format, ...)
{
    va_list values;
    size_t used;
    if (code == 0)
        return 1;
    report_line(line);
    used = strlen(messages);
    va_start(values, format);
    vsnprintf(messages + used, sizeof messages - used, format, values);
    va_end(values);
    report(" returned %d: %s\n", code, meaning(code));
    return 0;
}

static int row_refused(const Row *row, short code)
{
    int i;
    report_line(row->line);
    report("GT_%s(", NAMES[row->call]);
    for (i = 0; i < ARGUMENTS[row->call]; i++)
        report("%s%.15g", i ? "," : "", row->a[i]);
    report(") returned %d: %s\n", code, meaning(code));
    return 0;
}

static int not_stopped(int line)
{
    if (!gusjob_stop)
        return 1;
    report_line(line);
    report("stopped on request\n");
    return 0;
}

#define RUN(step)       \
    do {                \
        if (!(step))    \
            return 0;   \
    } while (0)
#define DO(line, call) RUN(not_stopped(line) && succeeded((call), line, "%s", #call))

static void sleep_1_ms(void)
{
#ifdef _WIN32
    Sleep(1);
#else
    struct timespec one_ms = {0, 1000000};
    nanosleep(&one_ms, NULL);
#endif
}

static double seconds(void)
{
#ifdef _WIN32
    return (double)GetTickCount64() / 1000;
#else
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + (double)now.tv_nsec / 1e9;
#endif
}

/* Read the progress of the motion. run = 0 with calls in the FIFO after it ran means starvation. GT_CrdStatus comes
   first: a system at rest consumes no more calls, so the space that is read after it is still valid. */
static int read_progress(int line, short crd, Progress *now)
{
    Crd *c = &crds[crd];
    memset(now, 0, sizeof *now);
    RUN(succeeded(GT_CrdStatus(crd, &now->run, &now->segment, c->fifo), line, "GT_CrdStatus(%d,run,segment,%d)", crd,
                  c->fifo));
    RUN(succeeded(GT_CrdSpace(crd, &now->space, c->fifo), line, "GT_CrdSpace(%d,space,%d)", crd, c->fifo));
    RUN(succeeded(GT_GetCrdPos(crd, now->position), line, "GT_GetCrdPos(%d,position)", crd));
    if (c->started && now->run)
        c->ran = 1;
    if (now->run || !c->ran || now->space >= c->size)
        return 1;
    report_line(line);
    report("the motion stopped with calls in the FIFO: it ran dry, or something stopped the axes\n");
    return 0;
}

static int crd_start(int line, long mask, long option)
{
    short crd;
    for (crd = 1; crd <= 2; crd++) {
        Crd *c = &crds[crd];
        if (!(mask >> (crd - 1) & 1))
            continue;
        if (c->early)
            mask &= ~(1L << (crd - 1));
        else
            c->fifo = (short)(option >> (crd - 1) & 1);
        c->early = 0;
        c->started = 1;
        c->line = line;
    }
    return !mask || (not_stopped(line) &&
                     succeeded(GT_CrdStart((short)mask, (short)option), line, "GT_CrdStart(%ld,%ld)", mask, option));
}

enum { FOR_SPACE, FOR_END };

/* Wait for space in the FIFO or for the end of the motion. */
static int wait_for(int what, int line, short crd)
{
    Crd *c = &crds[crd];
    Progress now, last;
    double since = seconds();
    memset(&last, 0, sizeof last);
    for (;;) {
        RUN(not_stopped(line) && read_progress(line, crd, &now));
        if (what == FOR_SPACE ? now.space > 0 : !now.run && now.space >= c->size)
            return 1;
        if (!c->started) {
            RUN(crd_start(line, 1L << (crd - 1), (long)c->fifo << (crd - 1)));
            c->early = 1;
        }
        if (memcmp(&now, &last, sizeof now) != 0) {
            memcpy(&last, &now, sizeof last);
            since = seconds();
        } else if (seconds() - since > (c->ran ? GUSJOB_PATIENCE_S : GUSJOB_START_S)) {
            report_line(line);
            report(c->ran ? "no progress for %d s\n" : "the motion did not start within %d s\n",
                 c->ran ? GUSJOB_PATIENCE_S : GUSJOB_START_S);
            return 0;
        }
        sleep_1_ms();
    }
}

/* GT_CrdClear. The space of the empty FIFO shows later whether calls are still in it. */
static int crd_clear(int line, short crd, short fifo)
{
    Crd *c = &crds[crd];
    RUN(not_stopped(line) && succeeded(GT_CrdClear(crd, fifo), line, "GT_CrdClear(%d,%d)", crd, fifo));
    memset(c, 0, sizeof *c);
    c->fifo = fifo;
    return succeeded(GT_CrdSpace(crd, &c->size, fifo), line, "GT_CrdSpace(%d,space,%d)", crd, fifo);
}

/* GT_CrdStatus: wait for the end of the motion, if it was started. */
static int crd_wait(int line, short crd, short fifo)
{
    Crd *c = &crds[crd];
    Progress now;
    c->fifo = fifo;
    if (!c->started)
        return not_stopped(line) && read_progress(line, crd, &now);
    RUN(wait_for(FOR_END, line, crd));
    c->started = c->early = c->ran = 0;
    return 1;
}

/* Make one buffered call. Only the calls of this job are compiled: not every library has all of them. */
static short make_call(const Row *row)
{
    const double *a = row->a;
    (void)a;
    switch (row->call) {
#ifdef GUSJOB_LnXY
    case LnXY:
        return GT_LnXY((short)a[0], (long)a[1], (long)a[2], a[3], a[4], a[5], (short)a[6]);
#endif
#ifdef GUSJOB_LnXYG0
    case LnXYG0:
        return GT_LnXYG0((short)a[0], (long)a[1], (long)a[2], a[3], a[4], (short)a[5]);
#endif
#ifdef GUSJOB_ArcXYC
    case ArcXYC:
        return GT_ArcXYC((short)a[0], (long)a[1], (long)a[2], a[3], a[4], (short)a[5], a[6], a[7], a[8], (short)a[9]);
#endif
#ifdef GUSJOB_ArcXYR
    case ArcXYR:
        return GT_ArcXYR((short)a[0], (long)a[1], (long)a[2], a[3], (short)a[4], a[5], a[6], a[7], (short)a[8]);
#endif
#ifdef GUSJOB_BufDelay
    case BufDelay:
        return GT_BufDelay((short)a[0], (unsigned short)a[1], (short)a[2]);
#endif
#ifdef GUSJOB_BufLaserOn
    case BufLaserOn:
        return GT_BufLaserOn((short)a[0], (short)a[1], (short)a[2]);
#endif
#ifdef GUSJOB_BufLaserOff
    case BufLaserOff:
        return GT_BufLaserOff((short)a[0], (short)a[1], (short)a[2]);
#endif
#ifdef GUSJOB_BufLaserPrfCmd
    case BufLaserPrfCmd:
        return GT_BufLaserPrfCmd((short)a[0], a[1], (short)a[2], (short)a[3]);
#endif
#ifdef GUSJOB_BufLaserPrfFollow
    case BufLaserPrfFollow:
        return GT_BufLaserPrfFollow((short)a[0], a[1], (long)a[2], (long)a[3], (short)a[4], (short)a[5]);
#endif
#ifdef GUSJOB_BufLaserFollowRatio
    case BufLaserFollowRatio:
        return GT_BufLaserFollowRatio((short)a[0], a[1], a[2], a[3], (short)a[4], (short)a[5]);
#endif
#ifdef GUSJOB_BufLaserFollowOff
    case BufLaserFollowOff:
        return GT_BufLaserFollowOff((short)a[0], (short)a[1], (short)a[2]);
#endif
#ifdef GUSJOB_BufLaserFollowMode
    case BufLaserFollowMode:
        return GT_BufLaserFollowMode((short)a[0], (short)a[1], (short)a[2], (short)a[3], a[4]);
#endif
    default:
        return 7;
    }
}

/* Send a buffered call. It may be refused while the FIFO is full, but not after space was seen. */
static int send_row(const Row *row)
{
    short crd = (short)row->a[0];
    int space = 0;
    crds[crd].fifo = (short)row->a[FIFO_AT[row->call]];
    for (;;) {
        short code;
        RUN(not_stopped(row->line));
        code = make_call(row);
        if (code == 0)
            return 1;
        if (code != 1 || space)
            return row_refused(row, code);
        RUN(wait_for(FOR_SPACE, row->line, crd));
        space = 1;
    }
}

#define PROGRESS_EVERY 64

static int feed(const Row *rows, long count)
{
    long i;
    Progress now;
    for (i = 0; i < count; i++) {
        short crd = (short)rows[i].a[0];
        RUN(send_row(&rows[i]));
        if (crds[crd].started && i % PROGRESS_EVERY == 0)
            RUN(read_progress(rows[i].line, crd, &now));
    }
    return 1;
}

static int run_job(void);

/* @job@ */

static int lasers_off(void)
{
    int i, tries, all = 1;
    for (i = 0; CHANNELS[i] >= 0; i++) {
        short code = 1;
        for (tries = 0; code && tries < 3; tries++)
            code = GT_SetHSIOOpt(0, CHANNELS[i]);
        if (!succeeded(code, 0, "GT_SetHSIOOpt(0,%d)", CHANNELS[i])) {
            report("THE LASER OF CHANNEL %d MAY BE ON\n", CHANNELS[i]);
            all = 0;
        }
    }
    return all;
}

/* Whether any of the job's coordinate systems still moves; one that does not answer counts as stopped. */
static int moving(void)
{
    int i, any = 0;
    for (i = 0; CRDS[i] >= 0; i++) {
        short run = 0;
        long segment = 0;
        if (GT_CrdStatus(CRDS[i], &run, &segment, crds[CRDS[i]].fifo) == 0 && run)
            any = 1;
    }
    return any;
}

/* Lasers off, stop, lasers off. A smooth stop would continue along the path, where queued calls may switch a laser on:
   the stop is abrupt. The lasers are switched off repeatedly until the motion has stopped. */
static void safe_shutdown(void)
{
    long mask = 0, abrupt;
    int i, tries, are_off = lasers_off();
    for (i = 0; CRDS[i] >= 0; i++)
        mask |= 1L << (7 + CRDS[i]); /* Bit 8 is coordinate system 1, bit 9 the other. */
    abrupt = mask;
    for (i = 0; AXES[i] >= 0; i++)
        abrupt |= 1L << (AXES[i] - 1); /* The bit of an axis is documented, too: bit 0 for axis 1. */
    if (mask)
        succeeded(GT_Stop(mask, abrupt), 0, "GT_Stop(%ld,%ld)", mask, abrupt);
    for (tries = 0; tries < 1000 && moving(); tries++) {
        for (i = 0; CHANNELS[i] >= 0; i++)
            GT_SetHSIOOpt(0, CHANNELS[i]);
        sleep_1_ms();
    }
    if (are_off)
        lasers_off();
}

static int wait_for_all(void)
{
    int i;
    for (i = 0; CRDS[i] >= 0; i++)
        if (crds[CRDS[i]].started)
            RUN(crd_wait(crds[CRDS[i]].line, CRDS[i], crds[CRDS[i]].fifo));
    return 1;
}

/* Shut down after a step that failed. */
static int end_in_error(void)
{
    safe_shutdown();
    fputs(messages, stderr);
    return gusjob_stop ? GUSJOB_STOPPED : GUSJOB_REFUSED;
}

int gusjob_run(void)
{
    int crd;
    /* A job may not use some of these. */
    (void)crd_clear, (void)feed, (void)crd_start;
    messages[0] = 0;
    memset(crds, 0, sizeof crds);
    for (crd = 1; crd <= 2; crd++)
        crds[crd].size = FIFO_SLOTS;
    if (run_job() && wait_for_all() && lasers_off())
        return GUSJOB_DONE;
    return end_in_error();
}

#ifndef GUSJOB_NO_MAIN
#ifdef _WIN32
/* Ctrl+C, Ctrl+Break, closed window, log-off, shutdown. After the last three Windows ends the process as soon as this
   returns, so it waits for the program to end. */
static BOOL WINAPI request_stop(DWORD event)
{
    gusjob_stop = 1;
    if (event != CTRL_C_EVENT && event != CTRL_BREAK_EVENT)
        Sleep(10000);
    return TRUE;
}

static void catch_signals(void)
{
    SetConsoleCtrlHandler(request_stop, TRUE);
}
#else
static void request_stop(int number)
{
    (void)number;
    gusjob_stop = 1;
}

static void catch_signals(void)
{
    struct sigaction action, before;
    memset(&action, 0, sizeof action);
    action.sa_handler = request_stop;
    action.sa_flags = SA_RESTART; /* The vendor's library may not handle interrupted calls. */
    sigemptyset(&action.sa_mask);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    if (sigaction(SIGHUP, NULL, &before) == 0 && before.sa_handler != SIG_IGN)
        sigaction(SIGHUP, &action, NULL);
    signal(SIGPIPE, SIG_IGN); /* A message that nobody reads must not end the program. */
}
#endif

static int prepare(char *configuration)
{
    int i;
    if (configuration != NULL)
        RUN(not_stopped(0) && succeeded(GT_LoadConfig(configuration), 0, "GT_LoadConfig(%s)", configuration));
    for (i = 0; AXES[i] >= 0; i++) {
        RUN(not_stopped(0) && succeeded(GT_ClrSts(AXES[i], 1), 0, "GT_ClrSts(%d,1)", AXES[i]));
        RUN(not_stopped(0) && succeeded(GT_AxisOn(AXES[i]), 0, "GT_AxisOn(%d)", AXES[i]));
    }
    return 1;
}

int main(int argc, char **argv)
{
    int status;
    short code;
    if (argc > 2) {
        fprintf(stderr, "usage: %s [CONFIGURATION]\n", argv[0]);
        return GUSJOB_REFUSED;
    }
    catch_signals();
    code = GUSJOB_OPEN;
    if (code != 0) {
        fprintf(stderr, "GT_Open returned %d: %s\n", code, meaning(code));
        return GUSJOB_REFUSED;
    }
    status = prepare(argc == 2 ? argv[1] : NULL) ? gusjob_run() : end_in_error();
    code = GT_Close();
    if (code != 0) {
        fprintf(stderr, "GT_Close() returned %d: %s\n", code, meaning(code));
        return GUSJOB_REFUSED;
    }
    return status;
}
#endif
