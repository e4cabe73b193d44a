/*
 * The calls: how each is carried out, its faults and its effect.
 */
#ifndef CALLS_H
#define CALLS_H

#include "state.h"

enum { DONE = 0, REFUSED = 1, PARAMETER = 7, UNSUPPORTED = 8, NOT_OPEN = -6, NO_RESPONSE = -7 };

/* ---- Faults -------------------------------------------------------------------------------------------------- */

/* The faults that are due in this call; each match is counted. They are planted in card 0, for all cards. */
static int due_faults(const char *name, Fault *due)
{
    State *planted = card_state[0];
    int i, count = 0;
    if (planted->faults == 0)
        return 0;
    lock_state();
    for (i = 0; i < planted->faults; i++) {
        Fault *f = &planted->fault[i];
        if (f->name[0] && strcmp(f->name, name) != 0)
            continue;
        f->seen++;
        if (f->seen >= f->nth && f->count == ALL_CALLS)
            f->name[0] = 0;
        if (f->seen >= f->nth && (f->count < 0 || f->seen < f->nth + f->count))
            due[count++] = *f;
    }
    unlock_state();
    return count;
}

static void plant_fault(Fault fault, const char *name)
{
    State *planted = card_state[0];
    if (planted->faults == FAULTS)
        return;
    snprintf(fault.name, sizeof fault.name, "%s", name);
    planted->fault[planted->faults++] = fault;
}

static void hang(double seconds)
{
    const State *planted = card_state[0];
    long releases = atomic_load(&planted->releases);
    double until = seconds > 0 ? wall_ms() + seconds * 1000 : INFINITY;
    while (!atomic_load(&planted->released) && atomic_load(&planted->releases) == releases && wall_ms() < until)
        nap_ms(1);
}

/* What befalls the process, outside the lock. */
static void befall_process(const Fault *f)
{
    if (f->what == F_HANG || f->what == F_HANG_RETURN)
        hang(f->value);
    else if (f->what == F_SIGNAL)
        signal_self((int)f->value);
    else if (f->what == F_KILL)
        signal_self(KILL_SIGNAL);
}

/* The same after the effect. */
static void befall_process_after(const Fault *f)
{
    if (f->what == F_HANG_AFTER)
        hang(f->value);
    else if (f->what == F_KILL_AFTER)
        signal_self(KILL_SIGNAL);
}

static void befall_machine(const Fault *f)
{
    if (f->what == F_HALT)
        halt();
    else if (f->what == F_DRY)
        run_dry();
    else if (f->what == F_DI)
        m->option[DI] = f->value;
}

/* ---- Calls --------------------------------------------------------------------------------------------------- */

/* What a call does, from its arguments; answers go to `out`. Its checks come first. */
typedef short Effect(const double *a, double *out);

/* Whether an effect needs no open card. */
static int works_closed(Effect *effect);

/* What is logged of a call. In the form, # is the next number and $ the text; @word is the next answer, ~word one that
   changes while the machine moves, each with a digit before the word for an array. Else it is text. */
typedef struct {
    int card;
    const char *name, *form;
    const double *given;
    const char *text;
} Call;

/* What the program with this machine does: whether a call counts as polling, how long it has waited since the last
   call (ms, in virtual time), and its log. */
static int polls(const char *name);
static double waited_ms(void);
static void log_rests(int card);
static void log_call(const Call *call, int code, const double *out);

/* Half of the latency. The clock of the wall goes on; virtual time takes none. */
static void take_latency(void)
{
    const double *option = card_state[0]->core[atomic_load(&card_state[0]->valid)].option;
    double ms = option[SPEED] > 0 ? option[LATENCY_US] / 2000 : 0;
    if (ms > 0)
        nap_ms(ms);
}

static int is_lacking(const char *name)
{
    size_t i;
    for (i = 0; is_set(LACKS) && i < sizeof LACKING / sizeof *LACKING; i++)
        if (strcmp(name, LACKING[i]) == 0)
            return (int)m->option[LACKS] >> i & 1;
    return 0;
}

/* `a`: what the effect takes. */
static short make_call(const Call *call, Effect *effect, const double *a, double *out)
{
    Fault due[FAULTS];
    int i, faults, returns = 0;
    short code = DONE;
    if (call->card < 0 || call->card >= CARDS)
        return PARAMETER;
    faults = due_faults(call->name, due);
    take_latency();
    for (i = 0; i < faults; i++)
        befall_process(&due[i]);
    enter(call->card);
    spend(waited_ms() + (m->option[CALL_US] + polls(call->name) * m->option[POLL_US]) / 1000);
    for (i = 0; i < faults; i++) {
        befall_machine(&due[i]);
        if ((due[i].what == F_RETURN || due[i].what == F_HANG_RETURN) && !returns) {
            returns = 1;
            code = due[i].what == F_RETURN ? (short)due[i].value : NO_RESPONSE;
        }
    }
    log_rests(call->card);
    if (!returns && !m->open && !works_closed(effect))
        code = NOT_OPEN;
    else if (!returns)
        code = is_lacking(call->name) ? UNSUPPORTED : effect(a, out);
    for (i = 0; i < faults; i++)
        if (due[i].what == F_AFTER && code == DONE)
            code = (short)due[i].value;
    commit();
    if (is_set(LOG))
        log_call(call, code, out);
    unlock_state();
    for (i = 0; i < faults; i++)
        befall_process_after(&due[i]);
    take_latency();
    return code;
}

static short call(int card, const char *name, const char *form, Effect *effect, const double *a, double *out)
{
    Call made = {.card = card, .name = name, .form = form, .given = a};
    return make_call(&made, effect, a, out);
}

static short call_with_text(int card, const char *name, const char *text, Effect *effect, const double *a)
{
    Call made = {.card = card, .name = name, .form = "$", .text = text};
    return make_call(&made, effect, a, NULL);
}

/* The body of a call that gives nothing back. */
#define CALL(name, form, effect, ...)                          \
    {                                                          \
        double a[] = {__VA_ARGS__};                            \
        return call(CARD_NUMBER, name, form, effect, a, NULL); \
    }

static int within(double value, double low, double high)
{
    return value >= low && value <= high;
}

static int above(double value, double low, double high)
{
    return value > low && value <= high;
}

static int below(double value, double high)
{
    return value >= 0 && value < high;
}

static int between(double value, double low, double high)
{
    return value > low && value < high;
}

static int is_crd(double crd)
{
    return within(crd, 1, 2);
}

static int is_bit(double value)
{
    return within(value, 0, 1);
}

static int is_place(double value)
{
    return within(value, -FARTHEST, FARTHEST);
}

static int is_power(double value, double channel)
{
    static const double HIGHEST[] = {100, 2000, 10, 100};
    return within(value, 0, HIGHEST[m->channel[(int)channel].mode]);
}

static short open_card(const double *a, double *out)
{
    (void)a;
    (void)out;
    m->open = 1;
    return DONE;
}

static short close_card(const double *a, double *out)
{
    (void)a;
    (void)out;
    m->open = 0;
    return DONE;
}

static short reset(const double *a, double *out)
{
    int i, k;
    (void)a;
    (void)out;
    halt();
    for (i = 0; i < 2; i++) {
        switch_at_once(i, 0);
        default_channel(&m->channel[i]);
        sample(&m->channel[i]);
        m->system[i] = (System){0};
        for (k = 0; k < 2; k++) {
            Fifo *f = &m->fifo[i][k];
            *f = (Fifo){.head = f->tail, .tail = f->tail, .fresh = 1};
        }
    }
    m->loaded = 0;
    m->axes = AXES_AT_POWER_UP;
    return DONE;
}

/* a: whether the pointer is there */
static short needs_pointer(const double *a, double *out)
{
    (void)out;
    return a[0] ? DONE : PARAMETER;
}

/* a: axis, count */
static short clear_status(const double *a, double *out)
{
    (void)out;
    return within(a[0], 1, 8) && within(a[1], 1, 9 - a[0]) ? DONE : PARAMETER;
}

/* Whether the axes that a coordinate system drives can move. */
static int has_servos(int crd)
{
    return (m->axes & m->system[crd - 1].axes) == m->system[crd - 1].axes;
}

/* a: axis, on */
static short switch_axis(const double *a, double *out)
{
    int bit, could_move = m->moving && has_servos(m->moving);
    (void)out;
    if (!within(a[0], 1, 8))
        return PARAMETER;
    bit = 1 << ((int)a[0] - 1);
    m->axes = a[1] != 0 ? m->axes | bit : m->axes & ~bit;
    if (could_move && !has_servos(m->moving)) {
        m->stopped_by_axis = m->moving;
        stop_abruptly();
    }
    return DONE;
}

/* a: kind of input, whether the pointer is there; out: value */
static short get_di(const double *a, double *out)
{
    if (!within(a[0], 0, 6) || !a[1])
        return PARAMETER;
    out[0] = m->option[DI];
    return DONE;
}

/* a: mask, option. Bits 0..7 are the axes, 8 and 9 the coordinate systems. */
static short stop(const double *a, double *out)
{
    long mine;
    (void)out;
    if (!within(a[0], 0, 0x3ff) || !within(a[1], 0, 0x3ff))
        return PARAMETER;
    if (!m->moving)
        return DONE;
    mine = (long)a[0] & (m->system[m->moving - 1].axes | 0x80L << m->moving);
    if (!mine)
        return DONE;
    if ((long)a[1] & mine)
        stop_abruptly();
    else
        stop_smoothly();
    return DONE;
}

/* a: axis, mode */
static short set_axis_mode(const double *a, double *out)
{
    (void)out;
    return (a[0] == 7 && is_bit(a[1])) || (a[0] == 8 && a[1] == 1) ? DONE : PARAMETER;
}

/* a: value, channel */
static short set_switch(const double *a, double *out)
{
    (void)out;
    if (!is_bit(a[0]) || !is_bit(a[1]))
        return PARAMETER;
    switch_at_once((int)a[1], a[0] != 0);
    return DONE;
}

/* a: channel, whether the pointer is there; out: value */
static short get_switch(const double *a, double *out)
{
    if (!is_bit(a[0]) || !a[1])
        return PARAMETER;
    out[0] = m->channel[(int)a[0]].command;
    return DONE;
}

/* a: mode, max, min, channel, delay mode. A new mode has another unit: the power is 0 again. */
static short set_power_mode(const double *a, double *out)
{
    static const double HIGHEST[] = {100, 2000, 10, 100};
    Channel *c;
    (void)out;
    if (!within(a[0], 0, 3) || !within(a[1], 0, HIGHEST[(int)a[0]]) || !within(a[2], 0, a[1]) || !is_bit(a[3])
        || !is_bit(a[4]))
        return PARAMETER;
    if (m->moving)
        return REFUSED;
    c = &m->channel[(int)a[3]];
    c->high = a[1];
    c->low = a[2];
    if (c->mode != (int)a[0])
        set_power(c, 0);
    c->mode = (int)a[0];
    sample(c);
    return DONE;
}

/* a: power, channel */
static short set_power_now(const double *a, double *out)
{
    (void)out;
    if (!is_bit(a[1]) || !is_power(a[0], a[1]))
        return PARAMETER;
    set_power(&m->channel[(int)a[1]], a[0]);
    sample(&m->channel[(int)a[1]]);
    return DONE;
}

/* a: kHz, channel */
static short set_carrier(const double *a, double *out)
{
    (void)out;
    if (!above(a[0], 0, 2000) || !is_bit(a[1]))
        return PARAMETER;
    m->channel[(int)a[1]].carrier = a[0];
    return DONE;
}

/* a: us, channel */
static short set_pulse_width(const double *a, double *out)
{
    (void)out;
    if (!within(a[0], 1, 65535) || !is_bit(a[1]))
        return PARAMETER;
    m->channel[(int)a[1]].pulse_width = a[0];
    return DONE;
}

/* a: on, kHz, %, channel. Standby is no emission here: it is kept, and that is all. */
static short set_standby(const double *a, double *out)
{
    Channel *c;
    (void)out;
    if (!is_bit(a[0]) || !above(a[1], 0, 2000) || !within(a[2], 0, 100) || !is_bit(a[3]))
        return PARAMETER;
    c = &m->channel[(int)a[3]];
    c->standby = a[0] != 0;
    c->standby_khz = a[1];
    c->standby_pct = a[2];
    return DONE;
}

/* a: on, V, channel */
static short set_prevoltage(const double *a, double *out)
{
    (void)out;
    if (!is_bit(a[0]) || !within(a[1], 0, 10) || !is_bit(a[2]))
        return PARAMETER;
    m->channel[(int)a[2]].has_prevoltage = a[0] != 0;
    m->channel[(int)a[2]].prevoltage = a[1];
    return DONE;
}

/* a: off us, on us, channel */
static short set_delays(const double *a, double *out)
{
    (void)out;
    if (!within(a[0], 0, 65535) || !within(a[1], 0, 65535) || !is_bit(a[2]))
        return PARAMETER;
    m->channel[(int)a[2]].off_delay = a[0] / 1000;
    m->channel[(int)a[2]].on_delay = a[1] / 1000;
    return DONE;
}

/* a: width us, gap us, late us, channel */
static short enable_fpk(const double *a, double *out)
{
    Channel *c;
    (void)out;
    if (!within(a[0], 1, 65535) || !within(a[1], 0, 65535) || !within(a[2], 0, 65535) || !is_bit(a[3]))
        return PARAMETER;
    c = &m->channel[(int)a[3]];
    c->fpk = 1;
    c->fpk_width = a[0] / 1000;
    c->fpk_gap = a[1] / 1000;
    c->fpk_late = a[2] / 1000;
    return DONE;
}

/* a: channel */
static short disable_fpk(const double *a, double *out)
{
    (void)out;
    if (!is_bit(a[0]))
        return PARAMETER;
    m->channel[(int)a[0]].fpk = 0;
    return DONE;
}

/* a: enable, source, reference[4], scale[4], channel, whether the pointers are there */
static short set_distance_mode(const double *a, double *out)
{
    Channel *c;
    int i, good = is_bit(a[0]) && is_bit(a[1]) && is_bit(a[10]) && a[11];
    (void)out;
    for (i = 0; i < 4 && good; i++)
        good = is_place(a[2 + i]) && between(a[6 + i], 0, INFINITY);
    if (!good)
        return PARAMETER;
    c = &m->channel[(int)a[10]];
    if (!c->distance) { /* enabled, it follows nothing until it is given a ratio */
        memset(c->distance_ratio, 0, sizeof c->distance_ratio);
        c->distance_low = -INFINITY;
        c->distance_high = INFINITY;
    }
    c->distance = a[0] != 0;
    c->source = a[1] != 0;
    memcpy(c->reference, a + 2, sizeof c->reference);
    memcpy(c->scale, a + 6, sizeof c->scale);
    sample(c);
    return DONE;
}

/* a: ratio[4], min, max, channel, whether the pointer is there */
static short set_distance_ratio(const double *a, double *out)
{
    Channel *c;
    int i, good = is_bit(a[6]) && a[7];
    (void)out;
    for (i = 0; i < 4 && good; i++)
        good = between(a[i], -INFINITY, INFINITY);
    if (!good || !is_power(a[4], a[6]) || !is_power(a[5], a[6]) || a[4] > a[5])
        return PARAMETER;
    c = &m->channel[(int)a[6]];
    if (!c->distance)
        return REFUSED;
    memcpy(c->distance_ratio, a, sizeof c->distance_ratio);
    c->distance_low = a[4];
    c->distance_high = a[5];
    sample(c);
    return DONE;
}

/* The axis, from 0, that a dimension drives: profile[k] names the dimension of axis k + 1. */
static int axis_of(const double *profile, double dimension, int otherwise)
{
    int i;
    for (i = 0; i < 8; i++)
        if (profile[i] == dimension)
            return i;
    return otherwise;
}

/* a: crd, dimension, profile[8], velocity, acceleration, even time, origin flag, origin[8], pointer. Without the flag
   the origin is where the head is, and originPos is not looked at: programs leave it as it is,
   as they do the profiles of other axes. */
static short set_crd(const double *a, double *out)
{
    const double *profile = a + 2, *origin = a + 14;
    int i, good = is_crd(a[0]) && a[22] && within(a[1], 1, 4) && between(a[10], 0, FASTEST)
                  && between(a[11], 0, FASTEST) && below(a[12], FASTEST) && is_bit(a[13]);
    System *system, made = new_system(), before;
    (void)out;
    for (i = 0; i < 8 && good; i++)
        good = !a[13] || is_place(origin[i]);
    if (!good)
        return PARAMETER;
    if (m->moving)
        return REFUSED;
    made.x_axis = axis_of(profile, 1, -1);
    made.y_axis = axis_of(profile, 2, -1);
    if (made.x_axis < 0 || made.y_axis < 0) {
        made.x_axis = 0;
        made.y_axis = 1;
    }
    made.dimension = (int)a[1];
    made.axes = 1 << made.x_axis | 1 << made.y_axis;
    made.origin_x = a[13] ? origin[made.x_axis] : m->x;
    made.origin_y = a[13] ? origin[made.y_axis] : m->y;
    made.vel_max = a[10];
    made.acc_max = a[11];
    made.even_time = a[12];
    system = &m->system[(int)a[0] - 1];
    before = *system;
    *system = made;
    system->smooth = before.smooth;
    system->abrupt = before.abrupt;
    return DONE;
}

/* a: crd, smooth, abrupt */
static short set_stop_dec(const double *a, double *out)
{
    System *system;
    (void)out;
    if (!is_crd(a[0]) || !between(a[1], 0, FASTEST) || !between(a[2], 0, FASTEST))
        return PARAMETER;
    system = &m->system[(int)a[0] - 1];
    system->smooth = a[1];
    system->abrupt = a[2];
    return DONE;
}

/* a: crd, fifo */
static short clear(const double *a, double *out)
{
    int crd = (int)a[0], lane = (int)a[1];
    Fifo *f;
    (void)out;
    if (!is_crd(a[0]) || !is_bit(a[1]))
        return PARAMETER;
    if (m->moving == crd)
        return REFUSED;
    if (m->owner == crd && m->lane == lane)
        m->loaded = 0;
    f = &m->fifo[crd - 1][lane];
    *f = (Fifo){.head = f->tail, .tail = f->tail, .fresh = 1};
    return DONE;
}

static long used_slots(int crd, int lane)
{
    const Fifo *f = &m->fifo[crd - 1][lane];
    return f->tail - f->head - (is_set(FREED_AT_START) && m->loaded && m->owner == crd && m->lane == lane);
}

static long free_slots(int crd, int lane)
{
    return (long)clamp(m->option[SLOT_COUNT], 1, SLOTS) - used_slots(crd, lane);
}

/* a: crd, fifo, pointer; out: slots */
static short space(const double *a, double *out)
{
    if (!is_crd(a[0]) || !is_bit(a[1]) || !a[2])
        return PARAMETER;
    out[0] = (double)free_slots((int)a[0], (int)a[1]);
    return DONE;
}

/* The stage's clock starts with it. */
static void new_origin(void)
{
    m->origin += m->t;
    m->t = m->tick = 0;
}

/* a: mask, option. A path that was interrupted is to be ended, or cleared, before another FIFO may start. */
static short start(const double *a, double *out)
{
    int crd = (int)a[0], lane;
    Fifo *f;
    (void)out;
    if (!within(a[0], 1, 3) || !within(a[1], 0, 3))
        return PARAMETER;
    if (crd == 3 || m->moving || !has_servos(crd) || !m->system[crd - 1].built)
        return REFUSED;
    lane = (int)a[1] >> (crd - 1) & 1;
    f = &m->fifo[crd - 1][lane];
    if (f->head == f->tail || (m->loaded && (m->owner != crd || m->lane != lane)))
        return REFUSED;
    if (is_set(DEAF))
        return DONE;
    end_lits();
    if (f->fresh)
        new_origin();
    f->fresh = 0;
    m->moving = m->owner = crd;
    m->lane = lane;
    m->started = m->t;
    if (m->loaded) {
        resume_path();
        begin_lits();
    } else {
        fetch();
    }
    return DONE;
}

/* a: crd, fifo, pointers; out: run, segment */
static short status(const double *a, double *out)
{
    const Fifo *f;
    if (!is_crd(a[0]) || !is_bit(a[1]) || !a[2])
        return PARAMETER;
    f = &m->fifo[(int)a[0] - 1][(int)a[1]];
    out[0] = m->moving == (int)a[0];
    out[1] = (double)(is_set(COUNTS_ALL) ? f->all : f->timed);
    return DONE;
}

/* How many positions a coordinate system has. Those beyond x and y are 0: they have no model. */
static int position_count(int card, int crd)
{
    int count = 2;
    if (card < 0 || card >= CARDS || !is_crd(crd))
        return count;
    lock_state();
    select_card(card);
    count = state->core[atomic_load(&state->valid)].system[crd - 1].dimension;
    unlock_state();
    return count > 2 ? count : 2;
}

/* a: crd, pointer; out: x, y in that coordinate system */
static short position(const double *a, double *out)
{
    const System *system;
    double velocity;
    if (!is_crd(a[0]) || !a[1])
        return PARAMETER;
    whereabouts(m->t, &velocity, &out[0], &out[1]);
    out[2] = out[3] = 0;
    system = &m->system[(int)a[0] - 1];
    out[0] -= system->origin_x;
    out[1] -= system->origin_y;
    if (!m->moving)
        out[0] += m->option[POS_ERROR];
    return DONE;
}

/* a: crd, pointer; out: velocity */
static short velocity(const double *a, double *out)
{
    double x, y;
    if (!is_crd(a[0]) || !a[1])
        return PARAMETER;
    whereabouts(m->t, &out[0], &x, &y);
    if (m->moving != (int)a[0])
        out[0] = 0;
    return DONE;
}

static short put(double crd_number, double lane_number, Slot call)
{
    int crd = (int)crd_number, lane = (int)lane_number;
    Fifo *f = &m->fifo[crd - 1][lane];
    if (!m->system[crd - 1].built || (m->moving == crd && m->lane != lane) || free_slots(crd, lane) <= 0)
        return REFUSED;
    call.ordinal = m->timed;
    m->timed += call.kind <= DELAY;
    m->accepted++;
    state->slot[crd - 1][lane][f->tail % RING] = call;
    f->tail++;
    if (m->moving == crd && !m->loaded) /* it waits for calls */
        fetch();
    return DONE;
}

/* a: crd, x, y; speed: velocity, acceleration, end velocity, and the fifo behind them */
static short put_motion(const double *a, const double *speed, Slot call)
{
    call.x = a[1];
    call.y = a[2];
    call.vel = speed[0];
    call.acc = speed[1];
    call.vel_end = speed[2];
    if (!is_crd(a[0]) || !is_place(a[1]) || !is_place(a[2]) || !between(call.vel, 0, FASTEST)
        || !between(call.acc, 0, FASTEST) || !below(call.vel_end, FASTEST) || !is_bit(speed[3]))
        return PARAMETER;
    return put(a[0], speed[3], call);
}

static short put_line(const double *a, double *out)
{
    (void)out;
    return put_motion(a, a + 3, (Slot){.kind = LINE});
}

/* a[3..5]: centre offset, direction */
static short put_arc_by_centre(const double *a, double *out)
{
    (void)out;
    if (!is_place(a[3]) || !is_place(a[4]) || (a[3] == 0 && a[4] == 0) || !is_bit(a[5]))
        return PARAMETER;
    return put_motion(a, a + 6, (Slot){.kind = ARC_CENTRE, .p = a[3], .q = a[4], .r = a[5]});
}

/* a[3..4]: radius, direction */
static short put_arc_by_radius(const double *a, double *out)
{
    (void)out;
    if (!is_place(a[3]) || a[3] == 0 || !is_bit(a[4]))
        return PARAMETER;
    return put_motion(a, a + 5, (Slot){.kind = ARC_RADIUS, .p = a[3], .r = a[4]});
}

/* a: crd, ms, fifo */
static short put_delay(const double *a, double *out)
{
    (void)out;
    if (!is_crd(a[0]) || !within(a[1], 0, 16383) || !is_bit(a[2]))
        return PARAMETER;
    return put(a[0], a[2], (Slot){.kind = DELAY, .p = a[1]});
}

/* a: crd, fifo, channel, on */
static short put_switch(const double *a, double *out)
{
    (void)out;
    if (!is_crd(a[0]) || !is_bit(a[1]) || !is_bit(a[2]))
        return PARAMETER;
    return put(a[0], a[1], (Slot){.kind = SWITCH, .channel = (int)a[2], .p = a[3]});
}

/* a: crd, power, fifo, channel */
static short put_power(const double *a, double *out)
{
    (void)out;
    if (!is_crd(a[0]) || !is_bit(a[2]) || !is_bit(a[3]) || !is_power(a[1], a[3]))
        return PARAMETER;
    return put(a[0], a[2], (Slot){.kind = POWER, .channel = (int)a[3], .p = a[1]});
}

#ifndef VC_NO_FOLLOW
/* a: crd, ratio, min, max, fifo, channel */
static short put_follow(const double *a, double *out)
{
    (void)out;
    if (!is_crd(a[0]) || !between(a[1], 0, INFINITY) || !is_bit(a[4]) || !is_bit(a[5]) || !is_power(a[2], a[5])
        || !is_power(a[3], a[5]) || a[2] >= a[3])
        return PARAMETER;
    return put(a[0], a[4], (Slot){.kind = FOLLOW, .channel = (int)a[5], .p = a[1], .q = a[2], .r = a[3]});
}
#endif

#endif
