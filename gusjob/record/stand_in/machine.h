/*
 * A virtual laser-galvo controller: its state, its light and its motion.
 *
 * Time is lazy: each call first brings the machine up to now, from event to event (end of a piece of motion, edge of
 * a switch) in closed form; only power that changes from tick to tick is looped over. Time is in ms, counted as `t`
 * from `origin`, the start of the stage, so that a long run costs no precision.
 *
 * The changing part, Core, stands in the state twice: a call works on a copy, and one atomic store makes the copy
 * valid, so that a kill at any instruction leaves either the machine before the call or that behind it. What is too
 * large to copy (FIFO slots, pending edges, logs) is only ever written beyond the counts that the valid core holds.
 */
#ifndef MACHINE_H
#define MACHINE_H

#include "platform.h"

#define SLOTS 4096
#define RING 8192     /* Twice the slots: a slot that a valid core still holds is never written. */
#define PENDING 16384 /* Edges under way in a delay line. */
#define FAULTS 32

/* Room for the logs of what was executed; cards that one library serves; axes whose servos are on at power-up. */
#ifndef ROWS
#define ROWS 1
#define EDGES 1
#define LITS 1
#endif
#ifndef CARDS
#define CARDS 1
#endif
#ifndef AXES_AT_POWER_UP
#define AXES_AT_POWER_UP 0
#endif

#define SLIVER 1e-9 /* ms: less is rounding. */
#define NEAR 1e-6   /* pulse: less is rounding. */
#define FULL_TURN 6.283185307179586477
#define FARTHEST 1073741823.0
#define FASTEST 32767.0

/* REST: emission at rest, no call. NOTHING: a call that takes a slot and has no effect here. */
enum { LINE, ARC_CENTRE, ARC_RADIUS, DELAY, SWITCH, POWER, FOLLOW, REST, NOTHING };

/* A buffered call. p, q, r: an arc's centre offset (or radius) and direction; a delay; on; a power; a follow. */
typedef struct {
    int kind, channel;
    double x, y, p, q, r, vel, acc, vel_end;
    long ordinal;
} Slot;

/* head and tail only grow; the call under way keeps its slot until it has ended. */
typedef struct {
    long head, tail, all, timed;
    int fresh; /* cleared, not started since */
} Fifo;

/* What GT_SetCrdPrm and GT_SetCrdStopDec have set, all 0 at first. No limit is 0; a smooth stop of 0 slows down as each
   call says, an abrupt one of 0 takes no time. axes: bits of those that X and Y drive. */
typedef struct {
    int built, dimension, axes, x_axis, y_axis;
    double origin_x, origin_y, vel_max, acc_max, even_time, smooth, abrupt;
} System;

/* The path of the timed call under way, on the machine: the call has its target there, too. */
typedef struct {
    Slot call;
    double origin_x, origin_y;
    double x0, y0, length;
    int arc;
    double cx, cy, radius, angle, sweep;
} Path;

/* Motion over a part of a path: three phases of constant acceleration, from `from` on the path on. */
typedef struct {
    double start, from, way, end_velocity, duration;
    double time[3], velocity[3], acceleration[3];
    int rests; /* it ends within the path */
} Piece;

typedef struct {
    double origin, t;
    int on;
} Edge;

/* Delays on edges and off edges each by their own time; edges that meet or cross go out together. */
typedef struct {
    unsigned head, tail;
    int on; /* what comes out */
} Line;

enum { SWITCH_LINE, LIGHT_LINE, LINES }; /* Level delays make the first, the first pulse killer the second. */

typedef struct {
    int command;
    Line line[LINES];
    double on_delay, off_delay;
    int fpk;
    double fpk_width, fpk_gap, fpk_late;
    int mode;
    double low, high;
    int follow;
    double base, ratio, follow_low, follow_high;
    int distance, source;
    double reference[4], scale[4], distance_ratio[4], distance_low, distance_high;
    double carrier, pulse_width, standby_khz, standby_pct, prevoltage;
    int standby, has_prevoltage;
    double held;  /* power since the last sample */
    double total; /* emission, ms */
} Channel;

enum {
    R_KIND, R_START, R_DURATION, R_X0, R_Y0, R_X1, R_Y1, R_LENGTH, R_V0, R_V1, R_EMISSION, R_POWER_MS = 12,
    R_MIN = 14, R_MAX, R_COMPLETED, R_CRD, R_CLOCK, R_ORDINAL, R_CX, R_CY, R_RADIUS, R_COLUMNS
};

/*
 * A lit stretch: emission on one piece of motion or dwell, or at rest. X, Y: the call's target, where it is for a dwell
 * and at rest. LEFT: to the call's end, in pulse along its path, in ms for a dwell. A stretch also ends where its power
 * becomes 0 or is 0 no longer. COMMAND: the state of the switch when it began; at rest 0 is the tail of an off delay.
 */
enum {
    L_CHANNEL, L_ORDINAL, L_KIND, L_X, L_Y, L_LEFT0, L_LEFT1, L_X0, L_Y0, L_X1, L_Y1, L_MS, L_CLOCK, L_POWER_MS,
    L_COMMAND, L_CX, L_CY, L_RADIUS, L_MIN, L_MAX, L_COLUMNS
};

enum { NO_ROW, OPEN_ROW, ENDED_ROW }; /* An ended row still takes the emission of an off delay. */

/*
 * speed: 0 is virtual time, where each call takes call_us and GT_CrdStatus poll_us more; else the clock is the wall's,
 * that many times as fast. segment_counts_all 0: GT_CrdStatus counts timed calls only. slot_freed_at_start: a call
 * leaves its slot when it begins. di: what GT_GetDi reads. log: keep the log of calls. pos_error: added to x that
 * GT_GetCrdPos tells at rest. deaf: GT_CrdStart starts nothing. stuck: motion is frozen, run stays 1. endless: run
 * stays 1 when the FIFO is empty. latency_us: real time that each call takes if speed is not 0, half of it before its
 * effect. unsupported: bits of LACKING, the calls that return 8.
 *
 * leave_*: what an earlier program left, from the moment at which the option is set. leave_on: bits of channels that
 * are on, at 40. leave_on_delay_us, leave_off_delay_us: level delays. leave_fpk_us: the first pulse killer, with this
 * width, gap and late. leave_distance: a distance follow that holds the power at this value. leave_moving: a line of
 * this length in x is under way.
 */
enum {
    SPEED, CALL_US, POLL_US, SLOT_COUNT, COUNTS_ALL, FREED_AT_START, PERIOD_US, DI, LOG, POS_ERROR, DEAF, STUCK,
    ENDLESS, LATENCY_US, LACKS, LEAVE_ON, LEAVE_ON_DELAY_US, LEAVE_OFF_DELAY_US, LEAVE_FPK_US, LEAVE_DISTANCE,
    LEAVE_MOVING, OPTIONS
};

static const struct {
    const char *name;
    double value;
} OPTION[OPTIONS] = {
    [SPEED] = {"speed", 0}, [CALL_US] = {"call_us", 20}, [POLL_US] = {"poll_us", 2000},
    [SLOT_COUNT] = {"slots", SLOTS}, [COUNTS_ALL] = {"segment_counts_all", 1},
    [FREED_AT_START] = {"slot_freed_at_start", 0}, [PERIOD_US] = {"period_us", 250}, [DI] = {"di", 0},
    [LOG] = {"log", 1}, [POS_ERROR] = {"pos_error", 0}, [DEAF] = {"deaf", 0}, [STUCK] = {"stuck", 0},
    [ENDLESS] = {"endless", 0}, [LATENCY_US] = {"latency_us", 0}, [LACKS] = {"unsupported", 0},
    [LEAVE_ON] = {"leave_on", 0}, [LEAVE_ON_DELAY_US] = {"leave_on_delay_us", 0},
    [LEAVE_OFF_DELAY_US] = {"leave_off_delay_us", 0}, [LEAVE_FPK_US] = {"leave_fpk_us", 0},
    [LEAVE_DISTANCE] = {"leave_distance", 0}, [LEAVE_MOVING] = {"leave_moving", 0},
};

static const char *LACKING[] = {
    "GT_SetLevelDelay", "GT_DisFPK", "GT_SetLaserDisMode", "GT_SetWaitPulse", "GT_SetPreVltg",
};

typedef struct {
    double option[OPTIONS];
    double origin, t;        /* ms: start of the stage, time since then */
    double base_now, base_wall; /* where the wall clock was tied to the machine's */
    double tick;             /* number of the next tick */
    int open, axes;
    System system[2];
    int moving, lane;        /* the coordinate system that moves (0: none); the FIFO that runs, or ran last */
    int owner;               /* the coordinate system of the path under way */
    int loaded, stopping;    /* a path is under way; on its way to rest */
    double stop_dec;         /* of that; 0: as each call says */
    int stopped_by_axis;     /* the coordinate system that the call at hand stopped with an axis's servo */
    double x, y, velocity;   /* at rest, or at the last end of a path */
    double ran, started;     /* running time up to the last start of motion, and t of that start */
    double rested_at[2];     /* clock at which a coordinate system came to rest */
    int rested[2];           /* it has, since the log last looked */
    long timed, accepted;
    Fifo fifo[2][2];
    Path path;
    Piece piece;
    Channel channel[2];
    double row[R_COLUMNS];
    int row_state;
    double lit[2][L_COLUMNS];
    int lit_open[2];
    long rows, edges, lits;
} Core;

/*
 * What a fault does. RETURN: the value is returned, without effect. AFTER: the value is returned in spite of the
 * effect. And before the effect, HANG: block until vc_release, or for the value in s; HALT: motion stops abruptly;
 * SIGNAL: the process gets the value; DRY: all that runs is run to its end; DI: the input becomes the value; KILL: the
 * process has ended. HANG_RETURN: block as HANG, then return -7 without effect. HANG_AFTER and KILL_AFTER: the same as
 * HANG and KILL, but after the effect. Faults of one call add up: HANG and RETURN block and return the value.
 */
enum {
    F_RETURN, F_AFTER, F_HANG, F_HALT, F_SIGNAL, F_DRY, F_DI, F_KILL, F_HANG_RETURN, F_HANG_AFTER, F_KILL_AFTER
};

enum { FOR_EVER = -1, ALL_CALLS = -2 }; /* Values of count: that call, or every call, from then on. */

typedef struct {
    char name[40];
    long nth, count, seen;
    int what;
    double value;
} Fault;

typedef struct {
    atomic_ulong made; /* 0: never set up */
    atomic_int valid;  /* which core holds */
    Core core[2];
    Slot slot[2][2][RING];
    Edge edge[2][LINES][PENDING];
    double row[ROWS][R_COLUMNS];
    double light[EDGES][4];
    double lit[LITS][L_COLUMNS];
    int faults;
    Fault fault[FAULTS];
    atomic_int released;  /* nothing hangs any more */
    atomic_long releases; /* what hangs now goes on when this changes */
} State;

static State *state; /* of the card that the call at hand is for */
static Core *m;      /* the copy that the call at hand works on */

static int is_set(int option)
{
    return m->option[option] != 0;
}

/* ---- Clock --------------------------------------------------------------------------------------------------- */

/* The machine's clock goes on from where it is, at the speed of the options. */
static void tie_clock(void)
{
    m->base_now = m->origin + m->t;
    m->base_wall = wall_ms();
}

static double running_ms(void)
{
    return m->ran + (m->moving ? m->t - m->started : 0);
}

/* ---- Where it is --------------------------------------------------------------------------------------------- */

static void point(double way, double *x, double *y)
{
    const Path *p = &m->path;
    double share = p->length > 0 ? way / p->length : 0;
    if (p->arc) {
        *x = p->cx + p->radius * cos(p->angle + p->sweep * share);
        *y = p->cy + p->radius * sin(p->angle + p->sweep * share);
    } else {
        *x = p->x0 + (p->call.x - p->x0) * share;
        *y = p->y0 + (p->call.y - p->y0) * share;
    }
}

/* Way along the path and velocity, u ms after the start of the piece. */
static double way_at(double u, double *velocity)
{
    const Piece *p = &m->piece;
    double way = p->from;
    int i;
    *velocity = p->velocity[0];
    for (i = 0; i < 3; i++) {
        double time = fmin(u, p->time[i]);
        *velocity = fmax(p->velocity[i] + p->acceleration[i] * time, 0);
        way += (p->velocity[i] + p->acceleration[i] * time / 2) * time;
        if (u < p->time[i])
            break;
        u -= p->time[i];
    }
    return fmin(way, p->from + p->way);
}

static void whereabouts(double t, double *velocity, double *x, double *y)
{
    *velocity = 0;
    *x = m->x;
    *y = m->y;
    if (m->moving && m->loaded) {
        point(way_at((is_set(STUCK) ? m->t : t) - m->piece.start, velocity), x, y);
        if (is_set(STUCK))
            *velocity = 0;
    }
}

/* ---- Light --------------------------------------------------------------------------------------------------- */

static double clamp(double value, double low, double high)
{
    return fmin(fmax(value, low), high);
}

/* The order of limits: follow's maximum, distance follow's both, the mode's both. */
static double power_at(const Channel *c, double t)
{
    double velocity, place[4] = {0}, power = c->base;
    int i;
    whereabouts(t, &velocity, &place[0], &place[1]);
    if (c->follow)
        power = fmin(c->ratio * velocity + c->follow_low, c->follow_high);
    if (c->distance) {
        for (i = 0; i < 4; i++)
            power += c->distance_ratio[i] * fabs(place[i] - c->reference[i]) / c->scale[i];
        power = clamp(power, c->distance_low, c->distance_high);
    }
    return clamp(power, c->low, c->high);
}

/* Where a stretch begins or ends at a time: what is left of the call, and the place. */
static void lit_place(double t, int kind, double *left, double *x, double *y)
{
    double velocity;
    *left = 0;
    *x = m->x;
    *y = m->y;
    if (is_set(STUCK))
        t = m->t;
    if (kind == DELAY) {
        *left = fmax(m->piece.start + m->piece.duration - t, 0);
    } else if (kind != REST) {
        double way = way_at(t - m->piece.start, &velocity);
        *left = m->path.length - way;
        point(way, x, y);
    }
}

/* The stretch that is open, as if it ended at a time. */
static void lit_until(double t, int channel, double row[L_COLUMNS])
{
    memcpy(row, m->lit[channel], sizeof m->lit[channel]);
    lit_place(t, (int)row[L_KIND], &row[L_LEFT1], &row[L_X1], &row[L_Y1]);
}

static void end_lit(int channel, double t)
{
    if (!m->lit_open[channel])
        return;
    m->lit_open[channel] = 0;
    if (m->lit[channel][L_MS] > SLIVER && m->lits < LITS)
        lit_until(t, channel, state->lit[m->lits++]);
}

static void begin_lit(int channel, double t)
{
    const Channel *c = &m->channel[channel];
    const Path *p = &m->path;
    double *row = m->lit[channel];
    int at_path = m->moving && m->loaded, kind = at_path ? p->call.kind : REST;
    if (!c->line[LIGHT_LINE].on || m->lit_open[channel])
        return;
    m->lit_open[channel] = 1;
    memset(row, 0, sizeof m->lit[channel]);
    lit_place(t, kind, &row[L_LEFT0], &row[L_X0], &row[L_Y0]);
    row[L_CHANNEL] = channel;
    row[L_ORDINAL] = at_path ? (double)p->call.ordinal : -1;
    row[L_KIND] = kind;
    row[L_X] = at_path && kind != DELAY ? p->call.x : m->x;
    row[L_Y] = at_path && kind != DELAY ? p->call.y : m->y;
    row[L_CLOCK] = m->origin + t;
    row[L_COMMAND] = c->command;
    row[L_MIN] = row[L_MAX] = NAN;
    if (at_path && p->arc) {
        row[L_CX] = p->cx;
        row[L_CY] = p->cy;
        row[L_RADIUS] = p->radius;
    }
}

/* Around each change of what moves. */
static void end_lits(void)
{
    end_lit(0, m->t);
    end_lit(1, m->t);
}

static void begin_lits(void)
{
    begin_lit(0, m->t);
    begin_lit(1, m->t);
}

/* The power from a time on. */
static void hold(int channel, double power, double t)
{
    Channel *c = &m->channel[channel];
    int parts = (power > 0) != (c->held > 0);
    if (parts)
        end_lit(channel, t);
    c->held = power;
    if (parts)
        begin_lit(channel, t);
}

static void sample(Channel *c)
{
    hold((int)(c - m->channel), power_at(c, m->t), m->t);
}

/* Light at rest is the last row's while it is but the delay of an off edge; else nobody's. */
static void shine(int channel, double ms)
{
    Channel *c = &m->channel[channel];
    c->total += ms;
    m->lit[channel][L_MS] += ms;
    m->lit[channel][L_POWER_MS] += ms * c->held;
    if (ms > SLIVER) {
        m->lit[channel][L_MIN] = fmin(m->lit[channel][L_MIN], c->held);
        m->lit[channel][L_MAX] = fmax(m->lit[channel][L_MAX], c->held);
    }
    if (m->row_state == OPEN_ROW || (m->row_state == ENDED_ROW && !c->command)) {
        m->row[R_EMISSION + channel] += ms;
        m->row[R_POWER_MS + channel] += ms * c->held;
        if (channel == 0 && ms > SLIVER) {
            m->row[R_MIN] = fmin(m->row[R_MIN], c->held);
            m->row[R_MAX] = fmax(m->row[R_MAX], c->held);
        }
    }
}

/* Light from now to a time, with samples at the ticks up to `last` (not included). */
static void shine_until(int channel, double to, double last)
{
    Channel *c = &m->channel[channel];
    double from = m->t, period = m->option[PERIOD_US] / 1000, tick = m->tick;
    int emits = c->line[LIGHT_LINE].on;
    /* At rest one tick is as good as the next; in the dark only the last one matters. */
    int still = !m->moving || !m->loaded || m->path.call.kind == DELAY || is_set(STUCK);
    if (!c->follow && !c->distance)
        tick = last;
    if (!emits && tick < last)
        tick = last - 1;
    for (; tick < last; tick = still ? last : tick + 1) {
        double at = clamp(tick * period, from, to);
        if (emits)
            shine(channel, at - from);
        hold(channel, power_at(c, at), at);
        from = at;
    }
    if (emits)
        shine(channel, to - from);
}

/* Time goes on, without any event on the way. */
static void pass(double to)
{
    double last = fmax(ceil((to - SLIVER) / (m->option[PERIOD_US] / 1000)), m->tick);
    shine_until(0, to, last);
    shine_until(1, to, last);
    m->tick = last;
    if (m->moving && m->loaded && is_set(STUCK)) {
        m->piece.start += to - m->t;
        m->row[R_DURATION] += to - m->t;
    }
    m->t = to;
}

static void log_light(int channel, int on)
{
    double *row = state->light[m->edges];
    if (m->edges == EDGES)
        return;
    row[0] = channel;
    row[1] = on;
    row[2] = m->origin + m->t;
    row[3] = running_ms();
    m->edges++;
}

static Edge *edge_of(int channel, int line, unsigned number)
{
    return &state->edge[channel][line][number % PENDING];
}

static void delayed(int channel, int line, double delay, int on)
{
    Line *l = &m->channel[channel].line[line];
    if (l->tail - l->head == PENDING)
        l->head += 2;
    *edge_of(channel, line, l->tail++) = (Edge){m->origin, m->t + delay, on};
}

static double time_of(const Edge *e)
{
    return e->origin - m->origin + e->t;
}

/* When the next edge comes out of a line. */
static double next_edge(int channel, int line)
{
    Line *l = &m->channel[channel].line[line];
    while (l->head != l->tail) {
        double time = time_of(edge_of(channel, line, l->head));
        if (l->tail - l->head == 1 || time_of(edge_of(channel, line, l->head + 1)) > time + SLIVER)
            return time;
        l->head += 2;
    }
    return INFINITY;
}

static void set_light(int channel, int on)
{
    Line *l = &m->channel[channel].line[LIGHT_LINE];
    int changes = l->on != on;
    if (changes)
        end_lit(channel, m->t);
    l->on = on;
    if (changes)
        begin_lit(channel, m->t);
    log_light(channel, on);
}

static void edge_out(int channel, int line)
{
    Channel *c = &m->channel[channel];
    Line *l = &c->line[line];
    int on = edge_of(channel, line, l->head++)->on;
    if (line == LIGHT_LINE) {
        set_light(channel, on);
        return;
    }
    l->on = on;
    delayed(channel, LIGHT_LINE, !c->fpk ? 0 : on ? c->fpk_gap : c->fpk_late, on);
}

static void switch_buffered(int channel, int on)
{
    Channel *c = &m->channel[channel];
    if (c->command != on)
        delayed(channel, SWITCH_LINE, on ? c->on_delay : c->off_delay, on);
    c->command = on;
}

/* Without delay, and whatever was under way is forgotten. */
static void switch_at_once(int channel, int on)
{
    Channel *c = &m->channel[channel];
    int i;
    c->command = on;
    if (c->line[LIGHT_LINE].on != on)
        set_light(channel, on);
    for (i = 0; i < LINES; i++) {
        c->line[i].head = c->line[i].tail;
        c->line[i].on = on;
    }
}

static void set_power(Channel *c, double power)
{
    c->follow = 0;
    c->base = power;
}

static void set_follow(Channel *c, double ratio, double low, double high)
{
    c->follow = 1;
    c->ratio = ratio;
    c->follow_low = low;
    c->follow_high = high;
}

/* ---- Motion -------------------------------------------------------------------------------------------------- */

static Fifo *running_fifo(void)
{
    return &m->fifo[m->owner - 1][m->lane];
}

static void flush_row(void)
{
    if (m->row_state == ENDED_ROW && m->rows < ROWS)
        memcpy(state->row[m->rows++], m->row, sizeof m->row);
    m->row_state = NO_ROW;
}

static void begin_row(void)
{
    double *row = m->row;
    flush_row();
    memset(row, 0, sizeof m->row);
    row[R_KIND] = m->path.call.kind;
    row[R_START] = running_ms();
    row[R_X0] = m->x;
    row[R_Y0] = m->y;
    row[R_V0] = m->velocity;
    row[R_LENGTH] = -m->piece.from;
    row[R_MIN] = row[R_MAX] = NAN;
    row[R_CRD] = m->owner;
    row[R_CLOCK] = m->origin + m->t;
    row[R_ORDINAL] = (double)m->path.call.ordinal;
    row[R_CX] = m->path.cx;
    row[R_CY] = m->path.cy;
    row[R_RADIUS] = m->path.radius;
    m->row_state = OPEN_ROW;
}

static void end_row(double way, double velocity, int completed)
{
    m->row[R_X1] = m->x;
    m->row[R_Y1] = m->y;
    m->row[R_V1] = velocity;
    m->row[R_LENGTH] += way;
    m->row[R_COMPLETED] = completed;
    m->row_state = ENDED_ROW;
}

static System *owning_system(void)
{
    return &m->system[m->owner - 1];
}

/* The velocity that leaves even_time at constant velocity, if one does without going below v0 or end. */
static double even_velocity(double way, double v0, double vel, double acc, double end, double even_time)
{
    double top2 = acc * way + (v0 * v0 + end * end) / 2, half = acc * even_time / 2;
    if (even_time <= 0 || v0 > vel)
        return vel;
    return fmin(vel, fmax(top2 / (half + sqrt(half * half + top2)), fmax(v0, end)));
}

/* From v0 to vel to vel_end, or to the end velocity next to it that can be reached. */
static void trapezoid(Piece *p, double v0, double vel, double acc, double vel_end, double even_time)
{
    double slowest = sqrt(fmax(v0 * v0 - 2 * acc * p->way, 0)), fastest = sqrt(v0 * v0 + 2 * acc * p->way);
    double end = clamp(fmin(vel_end, vel), slowest, fastest);
    double even = even_velocity(p->way, v0, vel, acc, end, even_time);
    double peak = v0 > vel ? fmax(vel, end) : fmin(even, sqrt(acc * p->way + (v0 * v0 + end * end) / 2));
    double first = fabs(peak - v0) / acc, last = fmax(peak - end, 0) / acc;
    double cruise = p->way - (v0 + peak) / 2 * first - (peak + end) / 2 * last;
    p->time[0] = first;
    p->velocity[0] = v0;
    p->acceleration[0] = peak < v0 ? -acc : acc;
    p->time[1] = cruise > 0 ? cruise / peak : 0;
    p->velocity[1] = p->velocity[2] = peak;
    p->time[2] = last;
    p->acceleration[2] = -acc;
    p->end_velocity = end;
}

/* Straight down, to rest or through the end of the path. */
static void slow_down(Piece *p, double v0, double acc)
{
    double to_rest = v0 * v0 / (2 * acc);
    p->rests = to_rest < p->way - NEAR;
    p->end_velocity = to_rest > p->way + NEAR ? sqrt(v0 * v0 - 2 * acc * p->way) : 0;
    p->way = fmin(p->way, to_rest);
    p->time[0] = (v0 - p->end_velocity) / acc;
    p->velocity[0] = v0;
    p->acceleration[0] = -acc;
}

/* Plans the rest of the path from `from`. */
static void plan(double from, double v0)
{
    const Slot *call = &m->path.call;
    const System *system = owning_system();
    double vel = system->vel_max > 0 ? fmin(call->vel, system->vel_max) : call->vel;
    double acc = system->acc_max > 0 ? fmin(call->acc, system->acc_max) : call->acc;
    Piece *p = &m->piece;
    memset(p, 0, sizeof *p);
    p->start = m->t;
    p->from = from;
    p->way = fmax(m->path.length - from, 0);
    if (call->kind == DELAY)
        p->time[0] = call->p;
    else if (m->stopping)
        slow_down(p, v0, m->stop_dec > 0 ? m->stop_dec : acc);
    else
        trapezoid(p, v0, vel, acc, call->vel_end, system->even_time);
    p->duration = p->time[0] + p->time[1] + p->time[2];
}

static double turned(double angle)
{
    return angle - FULL_TURN * floor(angle / FULL_TURN);
}

/* direction 0 clockwise, 1 counter-clockwise; a path that ends where it starts is a full circle. */
static void bend(Path *p, double cx, double cy, int direction)
{
    double turn = FULL_TURN, end = atan2(p->call.y - cy, p->call.x - cx);
    p->arc = 1;
    p->cx = cx;
    p->cy = cy;
    p->radius = hypot(p->x0 - cx, p->y0 - cy);
    p->angle = atan2(p->y0 - cy, p->x0 - cx);
    if (p->x0 != p->call.x || p->y0 != p->call.y)
        turn = turned(direction ? end - p->angle : p->angle - end);
    p->sweep = direction ? turn : -turn;
    p->length = p->radius * turn;
}

/* The centre of a minor arc lies to the left of its chord if it turns left; a major arc's on the other side. */
static void bend_by_radius(Path *p)
{
    double dx = p->call.x - p->x0, dy = p->call.y - p->y0, chord = p->length, radius = p->call.p;
    double off = sqrt(fmax(radius * radius - chord * chord / 4, 0)) / chord;
    int left = (p->call.r != 0) == (radius > 0);
    if (!left)
        off = -off;
    bend(p, p->x0 + dx / 2 - dy * off, p->y0 + dy / 2 + dx * off, p->call.r != 0);
}

static void load(const Slot *call)
{
    Path *p = &m->path;
    memset(p, 0, sizeof *p);
    p->call = *call;
    p->origin_x = owning_system()->origin_x;
    p->origin_y = owning_system()->origin_y;
    p->call.x += p->origin_x;
    p->call.y += p->origin_y;
    p->x0 = m->x;
    p->y0 = m->y;
    if (call->kind == DELAY) {
        m->velocity = 0;
    } else {
        p->length = hypot(p->call.x - p->x0, p->call.y - p->y0);
        if (call->kind == ARC_CENTRE)
            bend(p, p->x0 + call->p, p->y0 + call->q, call->r != 0);
        else if (call->kind == ARC_RADIUS && p->length > 0)
            bend_by_radius(p);
    }
    m->loaded = 1;
    plan(0, m->velocity);
    begin_row();
}

/* The path that was interrupted goes on; an origin that was set meanwhile has moved its target, not an arc's centre. */
static void resume_path(void)
{
    const Path *p = &m->path;
    const System *system = owning_system();
    Slot call = state->slot[m->owner - 1][m->lane][running_fifo()->head % RING];
    if (p->origin_x == system->origin_x && p->origin_y == system->origin_y) {
        plan(m->piece.from, 0);
        begin_row();
        return;
    }
    if (p->arc) {
        call.kind = ARC_CENTRE;
        call.p = p->cx - m->x;
        call.q = p->cy - m->y;
    }
    load(&call);
}

static void rest(void)
{
    m->rested[m->moving - 1] = 1;
    m->rested_at[m->moving - 1] = m->origin + m->t;
    m->ran = running_ms();
    m->moving = m->stopping = 0;
    m->velocity = 0;
}

static void drop_slot(int timed)
{
    Fifo *f = running_fifo();
    f->head++;
    f->all++;
    f->timed += timed;
}

static void carry_out(const Slot *call)
{
    Channel *c = &m->channel[call->channel];
    if (call->kind == SWITCH)
        switch_buffered(call->channel, call->p != 0);
    else if (call->kind == POWER)
        set_power(c, call->p);
    else if (call->kind == FOLLOW)
        set_follow(c, call->p, call->q, call->r);
}

/* Carries out calls up to the next timed one, and goes on with that. `power` tells whose power was among them. A stop
   that is over at the end of a path leaves all that is behind it. */
static void next_path(int power[2])
{
    Fifo *f = running_fifo();
    if (m->stopping && m->velocity == 0) {
        rest();
        return;
    }
    while (f->head != f->tail) {
        const Slot *call = &state->slot[m->owner - 1][m->lane][f->head % RING];
        if (call->kind <= DELAY) {
            if (m->stopping && call->kind == DELAY)
                rest();
            else
                load(call);
            return;
        }
        carry_out(call);
        power[call->channel] |= call->kind == POWER || call->kind == FOLLOW;
        drop_slot(0);
    }
    m->velocity = 0;
    if (m->stopping || !is_set(ENDLESS))
        rest();
}

/* Power calls sample the velocity with which the next path begins. */
static void fetch(void)
{
    int i, power[2] = {0};
    end_lits();
    next_path(power);
    for (i = 0; i < 2; i++)
        if (power[i])
            sample(&m->channel[i]);
    begin_lits();
}

/* The path under way is done with. */
static void complete(void)
{
    m->loaded = 0;
    drop_slot(1);
}

static void end_piece(void)
{
    const Piece *p = &m->piece;
    end_lits();
    m->row[R_DURATION] += p->duration;
    m->velocity = p->end_velocity;
    if (p->rests) {
        point(p->from + p->way, &m->x, &m->y);
        end_row(p->from + p->way, 0, 0);
        rest();
        m->piece.from += p->way;
        begin_lits();
        return;
    }
    if (m->path.call.kind != DELAY) {
        m->x = m->path.call.x;
        m->y = m->path.call.y;
    }
    end_row(m->path.length, m->velocity, 1);
    complete();
    fetch();
}

/* Runs the machine up to a time. At the same moment the path comes first, then the switch lines in their order, so
   that edges that meet find each other. */
static void advance(double until)
{
    for (;;) {
        double piece = m->moving && m->loaded && !is_set(STUCK) ? m->piece.start + m->piece.duration : INFINITY;
        double soonest = INFINITY;
        int line, channel, first = 0;
        for (line = LINES - 1; line >= 0; line--)
            for (channel = 0; channel < 2; channel++) {
                double time = next_edge(channel, line);
                if (time <= soonest + SLIVER) {
                    soonest = time;
                    first = line * 2 + channel;
                }
            }
        if (fmin(piece, soonest) > until)
            break;
        if (piece <= soonest + SLIVER) {
            pass(fmax(piece, m->t));
            end_piece();
        } else {
            pass(fmax(soonest, m->t));
            edge_out(first % 2, first / 2);
        }
    }
    if (until > m->t)
        pass(until);
}

/* Velocity 0 at once, where it is. An interrupted delay is over. */
static void halt(void)
{
    double velocity, way;
    if (!m->moving)
        return;
    end_lits();
    if (m->loaded) {
        way = way_at(m->t - m->piece.start, &velocity);
        point(way, &m->x, &m->y);
        m->row[R_DURATION] += m->t - m->piece.start;
        end_row(way, 0, 0);
        m->piece.from = way;
        if (m->path.call.kind == DELAY)
            complete();
    }
    rest();
    begin_lits();
}

/* Slows down to rest with a deceleration, 0: with that of each call. */
static void slow_to_rest(double dec)
{
    double velocity, way;
    if (!m->moving || m->stopping)
        return;
    if (!m->loaded || m->path.call.kind == DELAY) {
        halt();
        return;
    }
    way = way_at(m->t - m->piece.start, &velocity);
    m->row[R_DURATION] += m->t - m->piece.start;
    m->stopping = 1;
    m->stop_dec = dec;
    plan(way, velocity);
}

static void stop_smoothly(void)
{
    slow_to_rest(owning_system()->smooth);
}

static void stop_abruptly(void)
{
    double dec = owning_system()->abrupt;
    if (dec > 0)
        slow_to_rest(dec);
    else
        halt();
}

/* All that is queued is run at once; the clock jumps along. */
static void run_dry(void)
{
    while (m->moving && m->loaded && !is_set(STUCK))
        advance(fmax(m->piece.start + m->piece.duration, m->t));
    tie_clock();
}

#endif
