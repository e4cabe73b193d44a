/*
 * A virtual laser-galvo controller with the vendor's symbols, to run programs against and to see what comes out.
 *
 * VC_ABI says whose symbols: 0 GUS, 1 GTS (single card), 2 GTS (multi card: a leading cardNum). VC_NO_FOLLOW leaves
 * the velocity follow call out. The test controls vc_* stand at the end.
 *
 * Time is lazy: each call first brings the machine up to now, from event to event (end of a piece of motion, edge of
 * a switch) in closed form; only power that changes from tick to tick is looped over. Time is in ms, counted as `t`
 * from `origin`, the start of the stage, so that a long run costs no precision.
 *
 * With VC_STATE=file the machine lives in that file and survives its process. The changing part, Core, stands there
 * twice: a call works on a copy, and one atomic store makes the copy valid, so a kill at any instruction leaves
 * either the machine before the call or that behind it. What is too large to copy (FIFO slots, pending edges, logs)
 * is only ever written beyond the counts that the valid core holds. A file lock keeps processes apart, and goes with
 * the process that holds it.
 */
#define _DEFAULT_SOURCE
#define _DARWIN_C_SOURCE

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#ifndef VC_ABI
#define VC_ABI 0
#endif

#if VC_ABI == 0
#include "gts.h"
#else
typedef struct {
    short dimension;
    short profile[8];
    double synVelMax;
    double synAccMax;
    short evenTime;
    short setOriginFlag;
    long originPos[8];
} TCrdPrm;
#endif

#if VC_ABI == 2
#define CARD short cardNum,
#define CARD_ALONE short cardNum
#define ELSEWHERE (cardNum != 0)
#else
#define CARD
#define CARD_ALONE void
#define ELSEWHERE 0
#endif

enum { DONE = 0, REFUSED = 1, PARAMETER = 7, UNSUPPORTED = 8, NOT_OPEN = -6, NO_RESPONSE = -7 };

#define SLOTS 4096
#define RING 8192     /* Twice the slots: a slot that a valid core still holds is never written. */
#define PENDING 16384 /* Edges under way in a delay line. */
#define ROWS 200000
#define EDGES 400000
#define LITS 200000
#define FAULTS 32

#define SLIVER 1e-9 /* ms: less is rounding. */
#define NEAR 1e-6   /* pulse: less is rounding. */
#define FULL_TURN 6.283185307179586477
#define FARTHEST 1073741823.0
#define FASTEST 32767.0

/* ---- The machine --------------------------------------------------------------------------------------------- */

enum { LINE, ARC_CENTRE, ARC_RADIUS, DELAY, SWITCH, POWER, FOLLOW, REST }; /* REST: emission at rest, no call */

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

/* The path of the timed call under way. */
typedef struct {
    Slot call;
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
    int open, axes, built[2];
    int moving, lane;        /* the coordinate system that moves (0: none); the FIFO that runs, or ran last */
    int owner;               /* the coordinate system of the path under way */
    int loaded, stopping;    /* a path is under way; on its way to rest */
    double x, y, velocity;   /* at rest, or at the last end of a path */
    double ran, started;     /* running time up to the last start of motion, and t of that start */
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

static State unmapped;
static State *state = &unmapped;
static int state_file = -1;
static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
static Core *m; /* the copy that the call at hand works on */

static int is_set(int option)
{
    return m->option[option] != 0;
}

/* ---- Clock --------------------------------------------------------------------------------------------------- */

static double wall_ms(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec * 1e3 + (double)now.tv_nsec / 1e6;
}

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

/* From v0 to vel to vel_end, or to the end velocity next to it that can be reached. */
static void trapezoid(Piece *p, double v0, double vel, double acc, double vel_end)
{
    double slowest = sqrt(fmax(v0 * v0 - 2 * acc * p->way, 0)), fastest = sqrt(v0 * v0 + 2 * acc * p->way);
    double end = clamp(fmin(vel_end, vel), slowest, fastest);
    double peak = v0 > vel ? fmax(vel, end) : fmin(vel, sqrt(acc * p->way + (v0 * v0 + end * end) / 2));
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
    Piece *p = &m->piece;
    memset(p, 0, sizeof *p);
    p->start = m->t;
    p->from = from;
    p->way = fmax(m->path.length - from, 0);
    if (call->kind == DELAY)
        p->time[0] = call->p;
    else if (m->stopping)
        slow_down(p, v0, call->acc);
    else
        trapezoid(p, v0, call->vel, call->acc, call->vel_end);
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
    p->x0 = m->x;
    p->y0 = m->y;
    if (call->kind == DELAY) {
        m->velocity = 0;
    } else {
        p->length = hypot(call->x - p->x0, call->y - p->y0);
        if (call->kind == ARC_CENTRE)
            bend(p, p->x0 + call->p, p->y0 + call->q, call->r != 0);
        else if (call->kind == ARC_RADIUS && p->length > 0)
            bend_by_radius(p);
    }
    m->loaded = 1;
    plan(0, m->velocity);
    begin_row();
}

static void rest(void)
{
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
    else
        set_follow(c, call->p, call->q, call->r);
}

/* Carries out calls up to the next timed one, and goes on with that. `power` tells whose power was among them. */
static void next_path(int power[2])
{
    Fifo *f = running_fifo();
    while (f->head != f->tail) {
        const Slot *call = &state->slot[m->owner - 1][m->lane][f->head % RING];
        if (call->kind <= DELAY) {
            if (m->stopping && (m->velocity == 0 || call->kind == DELAY))
                rest();
            else
                load(call);
            return;
        }
        carry_out(call);
        power[call->channel] |= call->kind != SWITCH;
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

static void stop_smoothly(void)
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
    plan(way, velocity);
}

/* All that is queued is run at once; the clock jumps along. */
static void run_dry(void)
{
    while (m->moving && m->loaded && !is_set(STUCK))
        advance(fmax(m->piece.start + m->piece.duration, m->t));
    tie_clock();
}

/* ---- Power-up, and in and out of a call ---------------------------------------------------------------------- */

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

static short put(double crd_number, double lane_number, Slot call);
static short start(const double *a, double *out);

static void leave_line(double length)
{
    static const double SYSTEM_1[] = {1, 0};
    m->axes |= 3;
    m->built[0] = 1;
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

/* VC_OPTIONS: name=value,name=value */
static void set_options(const char *text)
{
    char name[40];
    double value;
    int used;
    while (text && sscanf(text, " %39[^=,]=%lf%n", name, &value, &used) == 2) {
        if (set_option(name, value) != 0)
            fprintf(stderr, "VC_OPTIONS: no option %s\n", name);
        text += used;
        text += *text == ',';
    }
}

static void power_up(void)
{
    int i;
    m = &state->core[!state->valid];
    memset(m, 0, sizeof *m);
    for (i = 0; i < OPTIONS; i++)
        m->option[i] = OPTION[i].value;
    for (i = 0; i < 2; i++) {
        default_channel(&m->channel[i]);
        m->fifo[i][0].fresh = m->fifo[i][1].fresh = 1;
    }
    tie_clock();
    set_options(getenv("VC_OPTIONS"));
    state->faults = 0;
    state->released = 0;
    state->releases++;
    atomic_store(&state->valid, (int)(m - state->core));
    atomic_store(&state->made, sizeof *state);
}

static void lock_file(short type)
{
    struct flock lock = {.l_type = type, .l_whence = SEEK_SET};
    while (state_file >= 0 && fcntl(state_file, F_SETLKW, &lock) != 0 && errno == EINTR)
        ;
}

static void lock_state(void)
{
    pthread_mutex_lock(&mutex);
    lock_file(F_WRLCK);
}

static void unlock_state(void)
{
    lock_file(F_UNLCK);
    pthread_mutex_unlock(&mutex);
}

static void map_state(const char *path)
{
    void *mapped = MAP_FAILED;
    state_file = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    if (state_file >= 0 && ftruncate(state_file, sizeof(State)) == 0)
        mapped = mmap(NULL, sizeof(State), PROT_READ | PROT_WRITE, MAP_SHARED, state_file, 0);
    if (mapped == MAP_FAILED) {
        perror(path);
        abort();
    }
    state = mapped;
}

__attribute__((constructor)) static void loaded(void)
{
    const char *path = getenv("VC_STATE");
    if (path && *path)
        map_state(path);
    lock_state();
    if (atomic_load(&state->made) != sizeof *state)
        power_up();
    unlock_state();
}

/* Virtual time goes on; the wall clock goes by itself. */
static void spend(double ms)
{
    if (m->option[SPEED] <= 0)
        advance(m->t + ms);
}

/* Locks, takes a copy of the machine, and brings it up to now. */
static void enter(void)
{
    int valid;
    lock_state();
    valid = atomic_load(&state->valid);
    m = &state->core[!valid];
    *m = state->core[valid];
    if (m->option[SPEED] > 0)
        advance(m->base_now - m->origin + (wall_ms() - m->base_wall) * m->option[SPEED]);
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

/* ---- Call log ------------------------------------------------------------------------------------------------ */

static char **calls;
static long call_count, call_room;

typedef struct {
    char text[1200];
    size_t size;
} Text;

__attribute__((format(printf, 2, 3))) static void print(Text *t, const char *format, ...)
{
    va_list args;
    int wrote;
    va_start(args, format);
    wrote = vsnprintf(t->text + t->size, sizeof t->text - t->size, format, args);
    va_end(args);
    t->size += (size_t)wrote;
    if (t->size >= sizeof t->text)
        t->size = sizeof t->text - 1;
}

/* The shortest text that reads back to the same number. */
static void print_number(Text *t, double value)
{
    char text[40];
    int digits = 15;
    if (value == floor(value) && fabs(value) < 1e16) {
        print(t, "%.0f", value);
        return;
    }
    do
        snprintf(text, sizeof text, "%.*g", digits, value);
    while (strtod(text, NULL) != value && digits++ < 17);
    print(t, "%s", text);
}

/* In the form of a call, # is the next argument and $ the text. */
static void log_call(int code, const char *name, const char *form, const double *a, const char *text)
{
    Text t = {.size = 0};
    print(&t, "%d %s(", code, name);
    for (; *form; form++)
        if (*form == '#')
            print_number(&t, *a++);
        else if (*form == '$')
            print(&t, "%s", text ? text : "NULL");
        else
            print(&t, "%c", *form);
    print(&t, ")");
    if (call_count == call_room) {
        call_room = call_room ? 2 * call_room : 1024;
        calls = realloc(calls, (size_t)call_room * sizeof *calls);
    }
    calls[call_count++] = strdup(t.text);
}

/* ---- Faults -------------------------------------------------------------------------------------------------- */

/* The faults that are due in this call; each match is counted. */
static int due_faults(const char *name, Fault *due)
{
    int i, count = 0;
    if (state->faults == 0)
        return 0;
    lock_state();
    for (i = 0; i < state->faults; i++) {
        Fault *f = &state->fault[i];
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

static void hang(double seconds)
{
    struct timespec nap = {.tv_nsec = 1000000};
    long releases = atomic_load(&state->releases);
    double until = seconds > 0 ? wall_ms() + seconds * 1000 : INFINITY;
    while (!atomic_load(&state->released) && atomic_load(&state->releases) == releases && wall_ms() < until)
        nanosleep(&nap, NULL);
}

/* What befalls the process, outside the lock. */
static void befall_process(const Fault *f)
{
    if (f->what == F_HANG || f->what == F_HANG_RETURN)
        hang(f->value);
    else if (f->what == F_SIGNAL)
        kill(getpid(), (int)f->value);
    else if (f->what == F_KILL)
        kill(getpid(), SIGKILL);
}

/* The same after the effect. */
static void befall_process_after(const Fault *f)
{
    if (f->what == F_HANG_AFTER)
        hang(f->value);
    else if (f->what == F_KILL_AFTER)
        kill(getpid(), SIGKILL);
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

static short open_card(const double *a, double *out);

/* Half of the latency. The clock of the wall goes on; virtual time takes none. */
static void take_latency(void)
{
    const double *option = state->core[atomic_load(&state->valid)].option;
    double ms = option[SPEED] > 0 ? option[LATENCY_US] / 2000 : 0;
    struct timespec nap = {.tv_sec = (time_t)(ms / 1000), .tv_nsec = (long)(fmod(ms, 1000) * 1e6)};
    while (ms > 0 && nanosleep(&nap, &nap) != 0 && errno == EINTR)
        ;
}

static int is_lacking(const char *name)
{
    size_t i;
    for (i = 0; is_set(LACKS) && i < sizeof LACKING / sizeof *LACKING; i++)
        if (strcmp(name, LACKING[i]) == 0)
            return (int)m->option[LACKS] >> i & 1;
    return 0;
}

static short call_with_text(const char *name, const char *form, Effect *effect, const double *a, double *out,
                            int polls, const char *text)
{
    Fault due[FAULTS];
    int i, faults = due_faults(name, due), returns = 0;
    short code = DONE;
    take_latency();
    for (i = 0; i < faults; i++)
        befall_process(&due[i]);
    enter();
    spend((m->option[CALL_US] + polls * m->option[POLL_US]) / 1000);
    for (i = 0; i < faults; i++) {
        befall_machine(&due[i]);
        if ((due[i].what == F_RETURN || due[i].what == F_HANG_RETURN) && !returns) {
            returns = 1;
            code = due[i].what == F_RETURN ? (short)due[i].value : NO_RESPONSE;
        }
    }
    if (!returns && !m->open && effect != open_card)
        code = NOT_OPEN;
    else if (!returns)
        code = is_lacking(name) ? UNSUPPORTED : effect(a, out);
    for (i = 0; i < faults; i++)
        if (due[i].what == F_AFTER && code == DONE)
            code = (short)due[i].value;
    commit();
    if (is_set(LOG))
        log_call(code, name, form, a, text);
    unlock_state();
    for (i = 0; i < faults; i++)
        befall_process_after(&due[i]);
    take_latency();
    return code;
}

static short call(const char *name, const char *form, Effect *effect, const double *a, double *out)
{
    return call_with_text(name, form, effect, a, out, 0, NULL);
}

/* The body of a call that gives nothing back. */
#define CALL(name, form, effect, ...)             \
    {                                             \
        double a[] = {__VA_ARGS__};               \
        if (ELSEWHERE)                            \
            return PARAMETER;                     \
        return call(name, form, effect, a, NULL); \
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
        m->built[i] = 0;
        for (k = 0; k < 2; k++) {
            Fifo *f = &m->fifo[i][k];
            *f = (Fifo){.head = f->tail, .tail = f->tail, .fresh = 1};
        }
    }
    m->loaded = m->axes = 0;
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

/* a: axis, on */
static short switch_axis(const double *a, double *out)
{
    int bit;
    (void)out;
    if (!within(a[0], 1, 8))
        return PARAMETER;
    bit = 1 << ((int)a[0] - 1);
    m->axes = a[1] != 0 ? m->axes | bit : m->axes & ~bit;
    if ((m->axes & 3) != 3) /* without its servos it can't move */
        halt();
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
    mine = (long)a[0] & (3 | 0x80L << m->moving);
    if (!m->moving || !mine)
        return DONE;
    if ((long)a[1] & mine)
        halt();
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

/* a: crd, dimension, profile[8], velocity, acceleration, even time, origin flag, origin[8], pointer */
static short set_crd(const double *a, double *out)
{
    int i, good = is_crd(a[0]) && a[22] && within(a[1], 1, 4) && between(a[10], 0, FASTEST)
                  && between(a[11], 0, FASTEST) && below(a[12], FASTEST) && is_bit(a[13]);
    (void)out;
    for (i = 0; i < 8 && good; i++)
        good = within(a[2 + i], 0, 8) && is_place(a[14 + i]);
    if (!good)
        return PARAMETER;
    if (m->moving)
        return REFUSED;
    m->built[(int)a[0] - 1] = 1;
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
    if (crd == 3 || m->moving || (m->axes & 3) != 3 || !m->built[crd - 1])
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
        plan(m->piece.from, 0);
        begin_row();
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

/* a: crd, pointer; out: x, y */
static short position(const double *a, double *out)
{
    double velocity;
    if (!is_crd(a[0]) || !a[1])
        return PARAMETER;
    whereabouts(m->t, &velocity, &out[0], &out[1]);
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
    if (!m->built[crd - 1] || (m->moving == crd && m->lane != lane) || free_slots(crd, lane) <= 0)
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

/* ---- The vendor's symbols ------------------------------------------------------------------------------------ */

short GT_Open(CARD short channel, short param) CALL("GT_Open", "#,#", open_card, channel, param)
short GT_Close(CARD_ALONE) CALL("GT_Close", "", close_card, 0)
short GT_Reset(CARD_ALONE) CALL("GT_Reset", "", reset, 0)
short GT_ClrSts(CARD short axis, short count) CALL("GT_ClrSts", "#,#", clear_status, axis, count)
short GT_AxisOn(CARD short axis) CALL("GT_AxisOn", "#", switch_axis, axis, 1)
short GT_AxisOff(CARD short axis) CALL("GT_AxisOff", "#", switch_axis, axis, 0)
short GT_Stop(CARD long mask, long option) CALL("GT_Stop", "#,#", stop, (double)mask, (double)option)

short GT_LoadConfig(CARD char *pFile)
{
    double a[] = {pFile != NULL};
    if (ELSEWHERE)
        return PARAMETER;
    return call_with_text("GT_LoadConfig", "$", needs_pointer, a, NULL, 0, pFile);
}

short GT_GetVersion(CARD char **pVersion)
{
    static char version[] = "virtual controller 1";
    double a[] = {pVersion != NULL};
    short code;
    if (ELSEWHERE)
        return PARAMETER;
    code = call("GT_GetVersion", "version", needs_pointer, a, NULL);
    if (code == DONE)
        *pVersion = version;
    return code;
}

short GT_GetDi(CARD short diType, long *pValue)
{
    double a[] = {diType, pValue != NULL}, out[1];
    short code;
    if (ELSEWHERE)
        return PARAMETER;
    code = call("GT_GetDi", "#,value", get_di, a, out);
    if (code == DONE)
        *pValue = (long)out[0];
    return code;
}

short GT_SetAxisMode(CARD short axis, short mode) CALL("GT_SetAxisMode", "#,#", set_axis_mode, axis, mode)
short GT_SetHSIOOpt(CARD unsigned short value, short channel) CALL("GT_SetHSIOOpt", "#,#", set_switch, value, channel)

short GT_GetHSIOOpt(CARD unsigned short *pValue, short channel)
{
    double a[] = {channel, pValue != NULL}, out[1];
    short code;
    if (ELSEWHERE)
        return PARAMETER;
    code = call("GT_GetHSIOOpt", "value,#", get_switch, a, out);
    if (code == DONE)
        *pValue = (unsigned short)out[0];
    return code;
}

#if VC_ABI == 0
short GT_LaserPowerMode(short mode, double maxValue, double minValue, short channel)
    CALL("GT_LaserPowerMode", "#,#,#,#", set_power_mode, mode, maxValue, minValue, channel, 0)
short GT_SetPulseWidth(unsigned short width, short channel)
    CALL("GT_SetPulseWidth", "#,#", set_pulse_width, width, channel)
#else
short GT_LaserPowerMode(CARD short mode, double maxValue, double minValue, short channel, short delaymode)
    CALL("GT_LaserPowerMode", "#,#,#,#,#", set_power_mode, mode, maxValue, minValue, channel, delaymode)
short GT_SetPulseWidth(CARD unsigned long width, short channel)
    CALL("GT_SetPulseWidth", "#,#", set_pulse_width, (double)width, channel)
#endif

short GT_LaserPrfCmd(CARD double outputCmd, short channel)
    CALL("GT_LaserPrfCmd", "#,#", set_power_now, outputCmd, channel)
short GT_LaserOutFrq(CARD double outFrq, short channel) CALL("GT_LaserOutFrq", "#,#", set_carrier, outFrq, channel)
short GT_SetWaitPulse(CARD unsigned short mode, double waitPulseFrq, double waitPulseDuty, short channel)
    CALL("GT_SetWaitPulse", "#,#,#,#", set_standby, mode, waitPulseFrq, waitPulseDuty, channel)
short GT_SetPreVltg(CARD unsigned short mode, double voltageValue, short channel)
    CALL("GT_SetPreVltg", "#,#,#", set_prevoltage, mode, voltageValue, channel)
short GT_SetLevelDelay(CARD unsigned short highLevelDelay, unsigned short lowLevelDelay, short channel)
    CALL("GT_SetLevelDelay", "#,#,#", set_delays, highLevelDelay, lowLevelDelay, channel)
short GT_EnaFPK(CARD unsigned short time1, unsigned short time2, unsigned short laserOffDelay, short channel)
    CALL("GT_EnaFPK", "#,#,#,#", enable_fpk, time1, time2, laserOffDelay, channel)
short GT_DisFPK(CARD short channel) CALL("GT_DisFPK", "#", disable_fpk, channel)

short GT_SetLaserDisMode(CARD short mode, short source, long *pPos, double *pScale, short channel)
{
    double a[12] = {mode, source};
    int i;
    if (ELSEWHERE)
        return PARAMETER;
    for (i = 0; i < 4 && pPos && pScale; i++) {
        a[2 + i] = (double)pPos[i];
        a[6 + i] = pScale[i];
    }
    a[10] = channel;
    a[11] = pPos && pScale;
    return call("GT_SetLaserDisMode", "#,#,{#,#,#,#},{#,#,#,#},#", set_distance_mode, a, NULL);
}

short GT_SetLaserDisRatio(CARD double *pRatio, double minPower, double maxPower, short channel)
{
    double a[8] = {0};
    if (ELSEWHERE)
        return PARAMETER;
    if (pRatio)
        memcpy(a, pRatio, 4 * sizeof *a);
    a[4] = minPower;
    a[5] = maxPower;
    a[6] = channel;
    a[7] = pRatio != NULL;
    return call("GT_SetLaserDisRatio", "{#,#,#,#},#,#,#", set_distance_ratio, a, NULL);
}

short GT_SetCrdPrm(CARD short crd, TCrdPrm *pCrdPrm)
{
    double a[23] = {crd};
    int i;
    if (ELSEWHERE)
        return PARAMETER;
    if (pCrdPrm) {
        a[1] = pCrdPrm->dimension;
        a[10] = pCrdPrm->synVelMax;
        a[11] = pCrdPrm->synAccMax;
        a[12] = pCrdPrm->evenTime;
        a[13] = pCrdPrm->setOriginFlag;
        for (i = 0; i < 8; i++) {
            a[2 + i] = pCrdPrm->profile[i];
            a[14 + i] = (double)pCrdPrm->originPos[i];
        }
    }
    a[22] = pCrdPrm != NULL;
    return call("GT_SetCrdPrm", "#,{#,{#,#,#,#,#,#,#,#},#,#,#,#,{#,#,#,#,#,#,#,#}}", set_crd, a, NULL);
}

short GT_CrdClear(CARD short crd, short fifo) CALL("GT_CrdClear", "#,#", clear, crd, fifo)

short GT_CrdSpace(CARD short crd, long *pSpace, short fifo)
{
    double a[] = {crd, fifo, pSpace != NULL}, out[1];
    short code;
    if (ELSEWHERE)
        return PARAMETER;
    code = call("GT_CrdSpace", "#,space,#", space, a, out);
    if (code == DONE)
        *pSpace = (long)out[0];
    return code;
}

short GT_CrdStart(CARD short mask, short option) CALL("GT_CrdStart", "#,#", start, mask, option)

short GT_CrdStatus(CARD short crd, short *pRun, long *pSegment, short fifo)
{
    double a[] = {crd, fifo, pRun && pSegment}, out[2];
    short code;
    if (ELSEWHERE)
        return PARAMETER;
    code = call_with_text("GT_CrdStatus", "#,run,segment,#", status, a, out, 1, NULL);
    if (code == DONE) {
        *pRun = (short)out[0];
        *pSegment = (long)out[1];
    }
    return code;
}

short GT_GetCrdPos(CARD short crd, double *pPos)
{
    double a[] = {crd, pPos != NULL}, out[2];
    short code;
    if (ELSEWHERE)
        return PARAMETER;
    code = call("GT_GetCrdPos", "#,position", position, a, out);
    if (code == DONE)
        memcpy(pPos, out, sizeof out);
    return code;
}

short GT_GetCrdVel(CARD short crd, double *pSynVel)
{
    double a[] = {crd, pSynVel != NULL}, out[1];
    short code;
    if (ELSEWHERE)
        return PARAMETER;
    code = call("GT_GetCrdVel", "#,velocity", velocity, a, out);
    if (code == DONE)
        *pSynVel = out[0];
    return code;
}

short GT_LnXY(CARD short crd, long x, long y, double synVel, double synAcc, double velEnd, short fifo)
    CALL("GT_LnXY", "#,#,#,#,#,#,#", put_line, crd, (double)x, (double)y, synVel, synAcc, velEnd, fifo)
short GT_ArcXYC(CARD short crd, long x, long y, double xCenter, double yCenter, short circleDir, double synVel,
                double synAcc, double velEnd, short fifo)
    CALL("GT_ArcXYC", "#,#,#,#,#,#,#,#,#,#", put_arc_by_centre, crd, (double)x, (double)y, xCenter, yCenter, circleDir,
         synVel, synAcc, velEnd, fifo)
short GT_ArcXYR(CARD short crd, long x, long y, double radius, short circleDir, double synVel, double synAcc,
                double velEnd, short fifo)
    CALL("GT_ArcXYR", "#,#,#,#,#,#,#,#,#", put_arc_by_radius, crd, (double)x, (double)y, radius, circleDir, synVel,
         synAcc, velEnd, fifo)
short GT_BufDelay(CARD short crd, unsigned short delayTime, short fifo)
    CALL("GT_BufDelay", "#,#,#", put_delay, crd, delayTime, fifo)
short GT_BufLaserOn(CARD short crd, short fifo, short channel)
    CALL("GT_BufLaserOn", "#,#,#", put_switch, crd, fifo, channel, 1)
short GT_BufLaserOff(CARD short crd, short fifo, short channel)
    CALL("GT_BufLaserOff", "#,#,#", put_switch, crd, fifo, channel, 0)
short GT_BufLaserPrfCmd(CARD short crd, double laserPower, short fifo, short channel)
    CALL("GT_BufLaserPrfCmd", "#,#,#,#", put_power, crd, laserPower, fifo, channel)

#ifndef VC_NO_FOLLOW
#if VC_ABI == 0
short GT_BufLaserPrfFollow(short crd, double ratio, long minPower, long maxPower, short fifo, short channel)
    CALL("GT_BufLaserPrfFollow", "#,#,#,#,#,#", put_follow, crd, ratio, (double)minPower, (double)maxPower, fifo,
         channel)
#else
short GT_BufLaserFollowRatio(CARD short crd, double ratio, double minPower, double maxPower, short fifo, short channel)
    CALL("GT_BufLaserFollowRatio", "#,#,#,#,#,#", put_follow, crd, ratio, minPower, maxPower, fifo, channel)
#endif
#endif

/* ---- Test controls ------------------------------------------------------------------------------------------- */

/* As if switched off and on again, and newly loaded. */
void vc_reset(void)
{
    lock_state();
    power_up();
    while (call_count > 0)
        free(calls[--call_count]);
    unlock_state();
}

static struct {
    Core core;
    Slot slot[2][2][RING];
    Edge edge[2][LINES][PENDING];
} kept;

/* Keeps the machine as it is now, in this process. */
void vc_keep(void)
{
    enter();
    kept.core = *m;
    memcpy(kept.slot, state->slot, sizeof kept.slot);
    memcpy(kept.edge, state->edge, sizeof kept.edge);
    leave();
}

/* Makes the machine what it was at vc_keep. Its logs have only grown since: they end where they ended then. */
void vc_recall(void)
{
    enter();
    *m = kept.core;
    memcpy(state->slot, kept.slot, sizeof kept.slot);
    memcpy(state->edge, kept.edge, sizeof kept.edge);
    tie_clock();
    leave();
}

/* 0, or -1 for an unknown name. */
int vc_option(const char *name, double value)
{
    int found;
    enter();
    found = set_option(name, value);
    leave();
    return found;
}

/* From the nth call of that name on (1: the next; name "": any call), `count` times, or FOR_EVER or ALL_CALLS. */
void vc_fault(const char *name, long nth, long count, int what, double value)
{
    lock_state();
    if (state->faults < FAULTS) {
        Fault *f = &state->fault[state->faults];
        *f = (Fault){.nth = nth, .count = count, .what = what, .value = value};
        snprintf(f->name, sizeof f->name, "%s", name);
        state->faults++;
    }
    unlock_state();
}

/* Faults that were planted are gone; what hangs goes on hanging. */
void vc_clear_faults(void)
{
    lock_state();
    state->faults = 0;
    unlock_state();
}

/* Calls that hang go on, and later ones don't hang. */
void vc_release(void)
{
    atomic_store(&state->released, 1);
    atomic_fetch_add(&state->releases, 1);
}

/* Virtual time only: the wall clock goes by itself. */
void vc_advance(double ms)
{
    enter();
    spend(ms);
    leave();
}

long vc_calls(void)
{
    long count;
    lock_state();
    count = call_count;
    unlock_state();
    return count;
}

/* "CODE NAME(arguments)", valid until vc_reset. */
const char *vc_call(long i)
{
    const char *text;
    lock_state();
    text = i >= 0 && i < call_count ? calls[i] : NULL;
    unlock_state();
    return text;
}

static long row_count(void)
{
    return m->rows + (m->row_state == ENDED_ROW);
}

/* Pieces of timed calls that have ended. */
long vc_rows(void)
{
    long count;
    enter();
    count = row_count();
    leave();
    return count;
}

void vc_row(long i, double out[23])
{
    enter();
    if (i >= 0 && i < row_count())
        memcpy(out, i < m->rows ? state->row[i] : m->row, sizeof m->row);
    leave();
}

long vc_edges(void)
{
    long count;
    enter();
    count = m->edges;
    leave();
    return count;
}

void vc_edge(long i, double out[4])
{
    enter();
    if (i >= 0 && i < m->edges)
        memcpy(out, state->light[i], sizeof state->light[i]);
    leave();
}

static int is_lit(int channel)
{
    return m->lit_open[channel] && m->lit[channel][L_MS] > SLIVER;
}

/* Lit stretches, with those that are lit now, up to now. */
long vc_lits(void)
{
    long count;
    enter();
    count = m->lits + is_lit(0) + is_lit(1);
    leave();
    return count;
}

void vc_lit(long i, double out[20])
{
    enter();
    if (i >= 0 && i < m->lits)
        memcpy(out, state->lit[i], sizeof state->lit[i]);
    else if (i >= m->lits && i < m->lits + is_lit(0) + is_lit(1))
        lit_until(m->t, i == m->lits && is_lit(0) ? 0 : 1, out);
    leave();
}

void vc_state(double out[16])
{
    const Channel *c;
    enter();
    c = m->channel;
    out[0] = m->origin + m->t;
    out[1] = m->open;
    out[2] = m->moving;
    whereabouts(m->t, &out[10], &out[3], &out[4]);
    out[5] = c[0].line[LIGHT_LINE].on;
    out[6] = c[1].line[LIGHT_LINE].on;
    out[7] = c[0].command;
    out[8] = c[1].command;
    out[9] = (double)(used_slots(1, 0) + used_slots(1, 1) + used_slots(2, 0) + used_slots(2, 1));
    out[11] = m->axes;
    out[12] = c[0].total;
    out[13] = c[1].total;
    out[14] = running_ms();
    out[15] = (double)m->accepted;
    leave();
}
