/*
 * Power-up, and in and out of a call.
 */
#ifndef STATE_H
#define STATE_H

#include "machine.h"

static void default_channel(Channel *c)
{
    double total = c->total;
    Line lines[LINES];
    memcpy(lines, c->line, sizeof lines);
    memset(c, 0, sizeof *c);
    memcpy(c->line, lines, sizeof lines);
    c->total = total;
    c->high = 100;
}

static System new_system(void)
{
    return (System){.built = 1, .axes = 3, .y_axis = 1};
}

static short put(double crd_number, double lane_number, Slot call);
static short start(const double *a, double *out);

static void leave_line(double length)
{
    static const double SYSTEM_1[] = {1, 0};
    m->axes |= 3;
    m->system[0] = new_system();
    put(1, 0, (Slot){.kind = LINE, .x = m->x + length, .y = m->y, .vel = 50, .acc = 10});
    start(SYSTEM_1, NULL);
}

/* What an earlier program left behind in a channel. */
static void leave_channel(int option, int channel, double value)
{
    Channel *c = &m->channel[channel];
    if (option == LEAVE_ON && (int)value >> channel & 1) {
        set_power(c, 40);
        switch_at_once(channel, 1);
    } else if (option == LEAVE_ON_DELAY_US) {
        c->on_delay = value / 1000;
    } else if (option == LEAVE_OFF_DELAY_US) {
        c->off_delay = value / 1000;
    } else if (option == LEAVE_FPK_US) {
        c->fpk = value > 0;
        c->fpk_width = c->fpk_gap = c->fpk_late = value / 1000;
    } else if (option == LEAVE_DISTANCE) {
        c->distance = value > 0;
        c->distance_low = c->distance_high = value;
        c->scale[0] = c->scale[1] = c->scale[2] = c->scale[3] = 1;
    }
    sample(c);
}

static int set_option(const char *name, double value)
{
    int i;
    for (i = 0; i < OPTIONS; i++)
        if (strcmp(name, OPTION[i].name) == 0) {
            m->option[i] = value;
            m->tick = ceil(m->t / (m->option[PERIOD_US] / 1000) - SLIVER);
            tie_clock();
            if (i == LEAVE_MOVING)
                leave_line(value);
            else if (i >= LEAVE_ON) {
                leave_channel(i, 0, value);
                leave_channel(i, 1, value);
            }
            return 0;
        }
    return -1;
}

/* The options that the program with this machine sets at power-up. */
static void configure(void);

static void power_up(void)
{
    int i;
    m = &state->core[!state->valid];
    memset(m, 0, sizeof *m);
    for (i = 0; i < OPTIONS; i++)
        m->option[i] = OPTION[i].value;
    m->axes = AXES_AT_POWER_UP;
    for (i = 0; i < 2; i++) {
        default_channel(&m->channel[i]);
        m->fifo[i][0].fresh = m->fifo[i][1].fresh = 1;
    }
    tie_clock();
    configure();
    state->faults = 0;
    state->released = 0;
    state->releases++;
    atomic_store(&state->valid, (int)(m - state->core));
    atomic_store(&state->made, sizeof *state);
}

/* Files that several processes share need a lock of their own. */
#ifdef SHARED_STATE
static void lock_shared_state(void);
static void unlock_shared_state(void);
#else
#define lock_shared_state()
#define unlock_shared_state()
#endif

static void lock_state(void)
{
    take_lock();
    lock_shared_state();
}

static void unlock_state(void)
{
    unlock_shared_state();
    give_lock();
}

/* Each card is a machine of its own; it is made when it is first used. */
static State *card_state[CARDS];
static double behind_ms[CARDS]; /* virtual time that calls of other cards took */

static void select_card(int card)
{
    state = card_state[card];
    if (state != NULL)
        return;
    state = card_state[card] = calloc(1, sizeof *state);
    if (state == NULL)
        abort();
    power_up();
}

/* Virtual time goes on, for all cards; the wall clock goes by itself. */
static void spend(double ms)
{
    int i;
    if (m->option[SPEED] > 0)
        return;
    for (i = 0; i < CARDS; i++)
        if (card_state[i] != state)
            behind_ms[i] += ms;
    advance(m->t + ms);
}

/* Locks, takes a copy of the card's machine, and brings it up to now. */
static void enter(int card)
{
    int valid;
    lock_state();
    select_card(card);
    valid = atomic_load(&state->valid);
    m = &state->core[!valid];
    *m = state->core[valid];
    if (m->option[SPEED] > 0)
        advance(m->base_now - m->origin + (wall_ms() - m->base_wall) * m->option[SPEED]);
    else if (behind_ms[card] > 0)
        advance(m->t + behind_ms[card]);
    behind_ms[card] = 0;
}

/* Makes the copy valid. */
static void commit(void)
{
    atomic_store(&state->valid, (int)(m - state->core));
}

static void leave(void)
{
    commit();
    unlock_state();
}

#endif
