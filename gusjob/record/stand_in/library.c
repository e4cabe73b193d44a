/*
 * A stand-in for the vendor's library that records the calls of a program, and carries them out on a virtual
 * controller.
 *
 * The environment says how. GUSJOB_RECORD: the listing's file, calls.gts in the current folder by default.
 * GUSJOB_RECORD_TIME=real: motion takes its time; by default virtual time goes on with each call, and while the program
 * itself waits. GUSJOB_RECORD_FAULTS=NAME:N:CODE,NAME:N+:CODE: the Nth call of that name returns the code without
 * effect; with + all from then on, too. GUSJOB_RECORD_LIMIT: bytes that a listing may have.
 */
#define CARDS 16
#define AXES_AT_POWER_UP 0xff /* Nothing says that a galvo head's axes must be switched on: M never does. */
static int chosen_card(void);

#include "more_symbols.h"

#include "listing.h"

#define WAITED_MS 5.0     /* A longer gap between two calls is the program's own waiting. */
#define REFUSED_MS 2.0    /* What a program needs to send a refused call again. */

static int is_real;
static double loaded_ms;        /* wall clock */
static double last_call_ms = -1; /* its end, wall clock */
static double owed_ms;          /* virtual time that the next call takes more */

static void configure(void)
{
    m->option[SPEED] = is_real;
    m->base_wall = loaded_ms;
}

static int polls(const char *name)
{
    return is_reading(name);
}

static double waited_ms(void)
{
    double gap = last_call_ms < 0 ? 0 : wall_ms() - last_call_ms, owed = owed_ms;
    owed_ms = 0;
    return owed + (gap >= WAITED_MS ? gap : 0);
}
