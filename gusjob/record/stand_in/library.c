/*
 * A stand-in for the vendor's library that records the calls of a program, and carries them out on a virtual
 * controller.
 *
 * The environment says how. GUSJOB_RECORD: the listing's file, calls.gts in the current folder by default.
 * GUSJOB_RECORD_TIME=real: motion takes its time; by default virtual time goes on with each call, and while the program
 * itself waits. GUSJOB_RECORD_FAULTS=NAME:N:CODE,NAME:N+:CODE: the Nth call of that name returns the code without
 * effect; with + all from then on, too. GUSJOB_RECORD_LIMIT: bytes that a listing may have. GUSJOB_RECORD_DI: what
 * GT_GetDi reads.
 */
#define CARDS 16
#define AXES_AT_POWER_UP 0xff /* Nothing says that a galvo head's axes must be switched on: M never does. */

static int chosen_card; /* of a library without card numbers: what GT_SetCardNo chose */
#define CARD_OF_CALL chosen_card

#include "more_symbols.h"

#include "gap.h"
#include "listing.h"
#ifndef WITHOUT_FUNCTIONS
#include "functions.h" /* generated: the functions without a model */
#endif

#define WAITED_MS 1.0     /* Time that counts, where the program certainly has waited between two calls; */
#define COMPUTED_MS 5.0   /* where it may only have computed. */
#define REFUSED_MS 2.0    /* What a program needs to send a refused call again. */

static int is_real;
static double loaded_ms;        /* wall clock */
static double inputs;           /* what GT_GetDi reads */
static Moment last_call;        /* its end */
static double owed_ms;          /* virtual time that the next call takes more */

static void configure(void)
{
    m->option[DI] = inputs;
    m->option[SPEED] = is_real;
    m->base_wall = loaded_ms;
}

static int works_closed(Effect *effect)
{
    return effect == open_card || effect == choose_card || effect == get_card;
}

static int polls(const char *name)
{
    return is_reading(name);
}

static double waited_ms(void)
{
    int has_waited = 0;
    double gap = last_call.wall_ms > 0 ? gap_ms(last_call, &has_waited) : 0, owed = owed_ms;
    owed_ms = 0;
    return owed + (gap >= (has_waited ? WAITED_MS : COMPUTED_MS) ? gap : 0);
}

static void log_rests(int card)
{
    int i;
    for (i = 0; i < 2; i++)
        if (m->rested[i])
            write_rest(card, m->rested_at[i], i + 1);
    m->rested[0] = m->rested[1] = 0;
}

static void log_call(const Call *call, int code, const double *out)
{
    write_call(call, m->origin + m->t, code, out);
    if (m->stopped_by_axis)
        write_stop(call->card, m->origin + m->t, m->stopped_by_axis, call->name);
    m->stopped_by_axis = 0;
    owed_ms = code == REFUSED ? REFUSED_MS : 0;
    last_call = moment();
}

/* NAME:N:CODE,NAME:N+:CODE */
static void plant_faults(const char *text)
{
    char name[40];
    long nth, code;
    int used;
    while (text && sscanf(text, "%39[^:,]:%ld%n", name, &nth, &used) == 2) {
        int lasts = text[used] == '+';
        text += used + lasts;
        if (sscanf(text, ":%ld%n", &code, &used) != 1)
            break;
        if (code == 0)
            break;
        plant_fault((Fault){.nth = nth, .count = lasts ? FOR_EVER : 1, .what = F_RETURN, .value = (double)code}, name);
        text += used;
        text += *text == ',';
    }
    if (text && *text)
        fprintf(stderr, "gusjob record: GUSJOB_RECORD_FAULTS: not NAME:N:CODE: %s\n", text);
}

/* A whole number in the environment. */
static double number_in(const char *name, double least, double otherwise)
{
    const char *text = getenv(name);
    char *end;
    long long value;
    if (text == NULL || !*text)
        return otherwise;
    value = strtoll(text, &end, 0);
    if (*end == 0 && (double)value >= least)
        return (double)value;
    fprintf(stderr, "gusjob record: %s: not a whole number from %.0f on: %s\n", name, least, text);
    return otherwise;
}

__attribute__((constructor)) static void loaded(void)
{
    const char *time = getenv("GUSJOB_RECORD_TIME");
    is_real = time != NULL && strcmp(time, "real") == 0;
    if (time != NULL && *time && !is_real && strcmp(time, "fast") != 0)
        fprintf(stderr, "gusjob record: GUSJOB_RECORD_TIME: not fast or real: %s\n", time);
    time_name = is_real ? "real" : "fast";
    limit_bytes = number_in("GUSJOB_RECORD_LIMIT", 1, limit_bytes);
    inputs = number_in("GUSJOB_RECORD_DI", 0, 0);
    loaded_ms = wall_ms();
#ifndef _WIN32
    pthread_atfork(take_lock, give_lock, give_lock); /* No call of another thread is under way in a process made new. */
#endif
    lock_state();
    select_card(0);
    plant_faults(getenv("GUSJOB_RECORD_FAULTS"));
    unlock_state();
}
