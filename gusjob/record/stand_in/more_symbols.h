/*
 * Symbols with a model that gusjob itself never calls, but programs do. Facts of the sister series.
 */
#ifndef MORE_SYMBOLS_H
#define MORE_SYMBOLS_H

#include "symbols.h"

/* Bits of an axis's status. */
enum { SERVO_ON = 0x200, PROFILE_RUNNING = 0x400, IN_POSITION = 0x800 };

enum { HOMED = 100 }; /* Homing is over, without an error. */

typedef struct {
    short run, stage, error, pad1;
    Long capturePos, targetPos;
} THomeStatus;

/* ---- Effects ------------------------------------------------------------------------------------------------- */

/* a: crd, fifo. A buffered call without a model takes its slot. */
static short put_nothing(const double *a, double *out)
{
    (void)out;
    if (!is_crd(a[0]) || !is_bit(a[1]))
        return PARAMETER;
    return put(a[0], a[1], (Slot){.kind = NOTHING});
}

/* An immediate call without a model. */
static short do_nothing(const double *a, double *out)
{
    (void)a;
    (void)out;
    return DONE;
}

/* a: crd, x, y, velocity, acceleration, fifo */
static short put_line_to_rest(const double *a, double *out)
{
    double speed[] = {a[3], a[4], 0, a[5]};
    (void)out;
    return put_motion(a, speed, (Slot){.kind = LINE});
}

static int is_axes(double axis, double count)
{
    return within(axis, 1, 8) && within(count, 1, 9 - axis);
}

/* The coordinate system whose axes are the head's: that which moved last, else axes 1 and 2. */
static System *driving_system(void)
{
    static System first;
    first = new_system();
    return m->owner && owning_system()->built ? owning_system() : &first;
}

/* a: axis, count, pointer; out: bits of each axis, then (out[8]) the clock in ms */
static short axis_status(const double *a, double *out)
{
    int i;
    out[8] = floor(m->origin + m->t);
    if (!is_axes(a[0], a[1]) || !a[2])
        return PARAMETER;
    for (i = 0; i < (int)a[1]; i++) {
        int bit = 1 << ((int)a[0] + i - 1), moves = m->moving && driving_system()->axes & bit, on = (m->axes & bit) != 0;
        out[i] = (on ? SERVO_ON : 0) + (moves ? PROFILE_RUNNING : on ? IN_POSITION : 0);
    }
    return DONE;
}

/* a: axis, count, pointer; out: position of each axis, then (out[8]) the clock in ms */
static short axis_position(const double *a, double *out)
{
    double velocity, x, y, place[8] = {0};
    out[8] = floor(m->origin + m->t);
    if (!is_axes(a[0], a[1]) || !a[2])
        return PARAMETER;
    whereabouts(m->t, &velocity, &x, &y);
    place[driving_system()->x_axis] = x;
    place[driving_system()->y_axis] = y;
    memcpy(out, place + (int)a[0] - 1, (size_t)a[1] * sizeof *out);
    return DONE;
}

/* a: crd, pointers; out: smooth, abrupt */
static short get_stop_dec(const double *a, double *out)
{
    if (!is_crd(a[0]) || !a[1])
        return PARAMETER;
    out[0] = m->system[(int)a[0] - 1].smooth;
    out[1] = m->system[(int)a[0] - 1].abrupt;
    return DONE;
}

/* a: crd, fifo, pointer; out: calls that are left */
static short remainder_count(const double *a, double *out)
{
    if (!is_crd(a[0]) || !is_bit(a[1]) || !a[2])
        return PARAMETER;
    out[0] = (double)used_slots((int)a[0], (int)a[1]);
    return DONE;
}

/* a: pointer; out: ms */
static short read_clock(const double *a, double *out)
{
    out[0] = floor(m->origin + m->t);
    return a[0] ? DONE : PARAMETER;
}

/* a: card */
static short choose_card(const double *a, double *out)
{
    (void)out;
    return within(a[0], 0, CARDS - 1) ? DONE : PARAMETER;
}

/* a: number of the card, pointer; out: that number */
static short get_card(const double *a, double *out)
{
    if (!a[1])
        return PARAMETER;
    out[0] = a[0];
    return DONE;
}

/* ---- Symbols ------------------------------------------------------------------------------------------------- */

/* A reading of several axes: axis, answers, count, clock. */
static short read_axes(int card, const char *name, const char *mark, Effect *effect, short axis, short count,
                       int has_pointer, double out[9])
{
    double given[] = {axis, count}, a[] = {axis, count, has_pointer};
    char form[40];
    Call made = {.card = card, .name = name, .form = form, .given = given};
    snprintf(form, sizeof form, "#,%s%.0danswers,#,clock", mark, count > 1 && count <= 8 ? count : 0);
    return make_call(&made, effect, a, out);
}

API GT_GetSts(CARD short axis, Long *pSts, short count, ULong *pClock)
{
    double out[9];
    int i;
    short code = read_axes(CARD_NUMBER, "GT_GetSts", "@", axis_status, axis, count, pSts != NULL, out);
    for (i = 0; code == DONE && i < count; i++)
        pSts[i] = (Long)out[i];
    if (code == DONE && pClock)
        *pClock = (ULong)out[8];
    return code;
}

/* The clock of the card, ms. */
API GT_GetClock(CARD ULong *pClock, ULong *pLoop)
{
    double a[] = {pClock != NULL}, out[1];
    short code = call(CARD_NUMBER, "GT_GetClock", "~clock,pointer", read_clock, a, out);
    if (code == DONE)
        *pClock = (ULong)out[0];
    if (code == DONE && pLoop)
        *pLoop = 0;
    return code;
}

static short read_positions(int card, const char *name, short axis, double *pValue, short count, ULong *pClock)
{
    double out[9];
    short code = read_axes(card, name, "~", axis_position, axis, count, pValue != NULL, out);
    if (code == DONE) {
        memcpy(pValue, out, (size_t)count * sizeof *out);
        if (pClock)
            *pClock = (ULong)out[8];
    }
    return code;
}

API GT_GetPrfPos(CARD short profile, double *pValue, short count, ULong *pClock)
{
    return read_positions(CARD_NUMBER, "GT_GetPrfPos", profile, pValue, count, pClock);
}

API GT_GetEncPos(CARD short encoder, double *pValue, short count, ULong *pClock)
{
    return read_positions(CARD_NUMBER, "GT_GetEncPos", encoder, pValue, count, pClock);
}

API GT_GetAxisPrfPos(CARD short axis, double *pValue, short count, ULong *pClock)
{
    return read_positions(CARD_NUMBER, "GT_GetAxisPrfPos", axis, pValue, count, pClock);
}

API GT_GetAxisEncPos(CARD short axis, double *pValue, short count, ULong *pClock)
{
    return read_positions(CARD_NUMBER, "GT_GetAxisEncPos", axis, pValue, count, pClock);
}

API GT_GetRemainderSegNum(CARD short crd, Long *pSegment, short fifo)
{
    double a[] = {crd, fifo, pSegment != NULL}, out[1];
    short code = call(CARD_NUMBER, "GT_GetRemainderSegNum", "#,~segment,#", remainder_count, a, out);
    if (code == DONE)
        *pSegment = (Long)out[0];
    return code;
}

API GT_GetCrdStopDec(CARD short crd, double *pDecSmoothStop, double *pDecAbruptStop)
{
    double a[] = {crd, pDecSmoothStop && pDecAbruptStop}, out[2];
    short code = call(CARD_NUMBER, "GT_GetCrdStopDec", "#,@smooth,@abrupt", get_stop_dec, a, out);
    if (code == DONE) {
        *pDecSmoothStop = out[0];
        *pDecAbruptStop = out[1];
    }
    return code;
}

API GT_GetLookAheadSpace(CARD short crd, Long *pSpace, short fifo)
{
    double a[] = {crd, fifo, pSpace != NULL}, out[1];
    short code = call(CARD_NUMBER, "GT_GetLookAheadSpace", "#,~space,#", space, a, out);
    if (code == DONE)
        *pSpace = (Long)out[0];
    return code;
}

#if VC_ABI != 2
/* Further calls are for that card. */
API GT_SetCardNo(short index)
{
    double a[] = {index};
    short code = call(CARD_NUMBER, "GT_SetCardNo", "#", choose_card, a, NULL);
    if (code == DONE)
        chosen_card = index;
    return code;
}

API GT_GetCardNo(short *pIndex)
{
    double a[] = {chosen_card, pIndex != NULL}, out[1];
    short code = call(CARD_NUMBER, "GT_GetCardNo", "@index", get_card, a, out);
    if (code == DONE)
        *pIndex = (short)out[0];
    return code;
}
#endif

/* Homing, which has no model, ends at once. */
API GT_GetHomeStatus(CARD short axis, THomeStatus *pHomeStatus)
{
    double a[] = {pHomeStatus != NULL};
    double given[] = {axis};
    Call made = {.card = CARD_NUMBER, .name = "GT_GetHomeStatus", .form = "#,pointer", .given = given};
    short code = make_call(&made, needs_pointer, a, NULL);
    if (code == DONE)
        *pHomeStatus = (THomeStatus){.stage = HOMED};
    return code;
}

API GT_LnXYG0(CARD short crd, Long x, Long y, double synVel, double synAcc, short fifo)
    CALL("GT_LnXYG0", "#,#,#,#,#,#", put_line_to_rest, crd, (double)x, (double)y, synVel, synAcc, fifo)

/* The velocity follow call of the other family. */
#if VC_ABI == 0
API GT_BufLaserFollowRatio(short crd, double ratio, double minPower, double maxPower, short fifo, short channel)
    CALL("GT_BufLaserFollowRatio", "#,#,#,#,#,#", put_follow, crd, ratio, minPower, maxPower, fifo, channel)
#else
API GT_BufLaserPrfFollow(CARD short crd, double ratio, Long minPower, Long maxPower, short fifo, short channel)
    CALL("GT_BufLaserPrfFollow", "#,#,#,#,#,#", put_follow, crd, ratio, (double)minPower, (double)maxPower, fifo,
         channel)
#endif

#endif
