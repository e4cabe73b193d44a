/*
 * A stand-in for the vendor's library. Each call is a line of stdout: its return code, a blank, the call.
 * FIFOs of 4096 slots; each GT_CrdStatus of a moving system takes STUB_DRAIN calls (48) out of its FIFO; an empty
 * FIFO ends the motion. What else it does is told by the environment:
 *   STUB_FAIL=CALL:CODE    that call always returns CODE        STUB_FAIL_AT=K:CODE  the Kth call of all returns CODE
 *   STUB_SIGNAL_AT=K       the Kth call raises SIGINT           STUB_ENDLESS=1       motion goes on for ever
 *   STUB_STUCK=1           the same, without progress           STUB_DRY=1           put calls are carried out at once
 *   STUB_DEAF=1            GT_CrdStart starts nothing           STUB_EVERY=N         only each Nth GT_CrdStatus drains
 */
#include "gts.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SLOTS 4096

static long queued[3][2];
static long segment[3];
static int moving[3];
static long calls, polls;

static long option(const char *name, long otherwise)
{
    const char *text = getenv(name);
    return text ? atol(text) : otherwise;
}

/* The return code of this call. */
static short answer(const char *name, short code)
{
    const char *fail = getenv("STUB_FAIL"), *at = getenv("STUB_FAIL_AT");
    calls++;
    if (option("STUB_SIGNAL_AT", 0) == calls)
        raise(SIGINT);
    if (fail && strncmp(fail, name, strlen(name)) == 0 && fail[strlen(name)] == ':')
        code = (short)atoi(fail + strlen(name) + 1);
    if (at && atol(at) == calls)
        code = (short)atoi(strchr(at, ':') + 1);
    printf("%d %s(", code, name);
    return code;
}

/* The shortest text that reads back to the same number. */
static void number(double value, const char *behind)
{
    char text[40];
    int digits = 1;
    do
        sprintf(text, "%.*g", digits, value);
    while (strtod(text, NULL) != value && digits++ < 17);
    printf("%s%s", text, behind);
}

static short end(short code)
{
    printf(")\n");
    fflush(stdout);
    return code;
}

static short plain(const char *name, short code, int count, const double *values)
{
    int i;
    code = answer(name, code);
    for (i = 0; i < count; i++)
        number(values[i], i < count - 1 ? "," : "");
    return end(code);
}

/* A call that does nothing but to be logged. */
#define PLAIN(name, count, ...)                \
    {                                          \
        double values[] = {__VA_ARGS__};       \
        return plain(name, 0, count, values);  \
    }

static void drain(short crd, long most)
{
    short fifo;
    if (!moving[crd])
        return;
    if (option("STUB_STUCK", 0))
        return;
    for (fifo = 0; fifo < 2; fifo++) {
        long taken = queued[crd][fifo] < most ? queued[crd][fifo] : most;
        queued[crd][fifo] -= taken;
        segment[crd] += taken;
    }
    if (option("STUB_ENDLESS", 0))
        segment[crd]++;
    else if (queued[crd][0] + queued[crd][1] == 0)
        moving[crd] = 0;
}

/* A buffered call. */
static short put(const char *name, short crd, short fifo, int count, const double *values)
{
    short full = queued[crd][fifo] >= SLOTS, code = plain(name, full, count, values);
    if (code == 0) {
        queued[crd][fifo]++;
        if (option("STUB_DRY", 0))
            drain(crd, SLOTS);
    }
    return code;
}

#define PUT(name, count, ...)                           \
    {                                                   \
        double values[] = {__VA_ARGS__};                \
        return put(name, crd, fifo, count, values);     \
    }

static short still(short crd)
{
    return moving[crd] ? 1 : 0;
}

short GT_Open(short channel, short param) PLAIN("GT_Open", 2, channel, param)
short GT_Close(void) PLAIN("GT_Close", 0, 0)
short GT_Reset(void) PLAIN("GT_Reset", 0, 0)
short GT_ClrSts(short axis, short count) PLAIN("GT_ClrSts", 2, axis, count)
short GT_AxisOn(short axis) PLAIN("GT_AxisOn", 1, axis)

short GT_LoadConfig(char *pFile)
{
    short code = answer("GT_LoadConfig", 0);
    printf("%s", pFile);
    return end(code);
}

short GT_Stop(long mask, long option_bits)
{
    double values[] = {(double)mask, (double)option_bits};
    short code = plain("GT_Stop", 0, 2, values);
    if (code == 0) {
        moving[1] = moving[1] && !(mask & 1 << 8);
        moving[2] = moving[2] && !(mask & 1 << 9);
    }
    return code;
}

short GT_SetAxisMode(short axis, short mode) PLAIN("GT_SetAxisMode", 2, axis, mode)
short GT_SetHSIOOpt(unsigned short value, short channel) PLAIN("GT_SetHSIOOpt", 2, value, channel)
short GT_LaserPrfCmd(double outputCmd, short channel) PLAIN("GT_LaserPrfCmd", 2, outputCmd, channel)
short GT_LaserOutFrq(double outFrq, short channel) PLAIN("GT_LaserOutFrq", 2, outFrq, channel)
short GT_SetPulseWidth(unsigned short width, short channel) PLAIN("GT_SetPulseWidth", 2, width, channel)
short GT_SetPreVltg(unsigned short mode, double volts, short channel) PLAIN("GT_SetPreVltg", 3, mode, volts, channel)
short GT_SetWaitPulse(unsigned short mode, double frq, double duty, short channel)
    PLAIN("GT_SetWaitPulse", 4, mode, frq, duty, channel)
short GT_SetLevelDelay(unsigned short high, unsigned short low, short channel)
    PLAIN("GT_SetLevelDelay", 3, high, low, channel)
short GT_EnaFPK(unsigned short time1, unsigned short time2, unsigned short laserOffDelay, short channel)
    PLAIN("GT_EnaFPK", 4, time1, time2, laserOffDelay, channel)
short GT_DisFPK(short channel) PLAIN("GT_DisFPK", 1, channel)

/* Only at rest (laser manual, 2.2). */
short GT_LaserPowerMode(short mode, double high, double low, short channel)
{
    double values[] = {mode, high, low, channel};
    return plain("GT_LaserPowerMode", still(1) || still(2), 4, values);
}

short GT_GetHSIOOpt(unsigned short *pValue, short channel)
{
    short code = answer("GT_GetHSIOOpt", 0);
    *pValue = 0;
    printf("value,%d", channel);
    return end(code);
}

static void array(const double *values, int count)
{
    int i;
    printf("{");
    for (i = 0; i < count; i++)
        number(values[i], i < count - 1 ? "," : "},");
}

short GT_SetLaserDisMode(short mode, short source, long *pPos, double *pScale, short channel)
{
    short code = answer("GT_SetLaserDisMode", 0);
    double pos[4] = {(double)pPos[0], (double)pPos[1], (double)pPos[2], (double)pPos[3]};
    printf("%d,%d,", mode, source);
    array(pos, 4);
    array(pScale, 4);
    printf("%d", channel);
    return end(code);
}

short GT_SetLaserDisRatio(double *pRatio, double minPower, double maxPower, short channel)
{
    short code = answer("GT_SetLaserDisRatio", 0);
    array(pRatio, 4);
    number(minPower, ",");
    number(maxPower, ",");
    printf("%d", channel);
    return end(code);
}

short GT_SetCrdPrm(short crd, TCrdPrm *pCrdPrm)
{
    short code = answer("GT_SetCrdPrm", still(crd));
    double profile[8], origin[8];
    int i;
    for (i = 0; i < 8; i++) {
        profile[i] = pCrdPrm->profile[i];
        origin[i] = (double)pCrdPrm->originPos[i];
    }
    printf("%d,{%d,", crd, pCrdPrm->dimension);
    array(profile, 8);
    number(pCrdPrm->synVelMax, ",");
    number(pCrdPrm->synAccMax, ",");
    printf("%d,%d,{", pCrdPrm->evenTime, pCrdPrm->setOriginFlag);
    for (i = 0; i < 8; i++)
        number(origin[i], i < 7 ? "," : "}}");
    return end(code);
}

short GT_SetCrdStopDec(short crd, double smooth, double abrupt) PLAIN("GT_SetCrdStopDec", 3, crd, smooth, abrupt)

short GT_CrdClear(short crd, short fifo)
{
    double values[] = {crd, fifo};
    short code = plain("GT_CrdClear", still(crd), 2, values);
    if (code == 0)
        queued[crd][fifo] = segment[crd] = 0;
    return code;
}

short GT_CrdSpace(short crd, long *pSpace, short fifo)
{
    double values[] = {crd, (double)(SLOTS - queued[crd][fifo]), fifo};
    *pSpace = SLOTS - queued[crd][fifo];
    return plain("GT_CrdSpace", 0, 3, values);
}

short GT_CrdStart(short mask, short bits)
{
    double values[] = {mask, bits};
    short code = plain("GT_CrdStart", 0, 2, values), crd;
    for (crd = 1; crd <= 2; crd++)
        if (code == 0 && mask >> (crd - 1) & 1 && !option("STUB_DEAF", 0))
            moving[crd] = 1;
    return code;
}

/* Logged with what it found: crd, run, segment, fifo. */
short GT_CrdStatus(short crd, short *pRun, long *pSegment, short fifo)
{
    double values[4] = {crd, 0, 0, fifo};
    values[1] = *pRun = still(crd);
    values[2] = (double)(*pSegment = segment[crd]);
    if (++polls % option("STUB_EVERY", 1) == 0)
        drain(crd, option("STUB_DRAIN", 48));
    return plain("GT_CrdStatus", 0, 4, values);
}

short GT_GetCrdPos(short crd, double *pPos)
{
    double values[] = {crd, (double)segment[crd]};
    pPos[0] = pPos[1] = (double)segment[crd];
    return plain("GT_GetCrdPos", 0, 2, values);
}

short GT_LnXY(short crd, long x, long y, double vel, double acc, double velEnd, short fifo)
    PUT("GT_LnXY", 7, crd, (double)x, (double)y, vel, acc, velEnd, fifo)
short GT_LnXYG0(short crd, long x, long y, double vel, double acc, short fifo)
    PUT("GT_LnXYG0", 6, crd, (double)x, (double)y, vel, acc, fifo)
short GT_ArcXYC(short crd, long x, long y, double xc, double yc, short dir, double vel, double acc, double velEnd,
                short fifo)
    PUT("GT_ArcXYC", 10, crd, (double)x, (double)y, xc, yc, dir, vel, acc, velEnd, fifo)
short GT_ArcXYR(short crd, long x, long y, double r, short dir, double vel, double acc, double velEnd, short fifo)
    PUT("GT_ArcXYR", 9, crd, (double)x, (double)y, r, dir, vel, acc, velEnd, fifo)
short GT_BufDelay(short crd, unsigned short ms, short fifo) PUT("GT_BufDelay", 3, crd, ms, fifo)
short GT_BufLaserOn(short crd, short fifo, short channel) PUT("GT_BufLaserOn", 3, crd, fifo, channel)
short GT_BufLaserOff(short crd, short fifo, short channel) PUT("GT_BufLaserOff", 3, crd, fifo, channel)
short GT_BufLaserPrfCmd(short crd, double power, short fifo, short channel)
    PUT("GT_BufLaserPrfCmd", 4, crd, power, fifo, channel)
short GT_BufLaserPrfFollow(short crd, double ratio, long low, long high, short fifo, short channel)
    PUT("GT_BufLaserPrfFollow", 6, crd, ratio, (double)low, (double)high, fifo, channel)
short GT_BufLaserFollowRatio(short crd, double ratio, double low, double high, short fifo, short channel)
    PUT("GT_BufLaserFollowRatio", 6, crd, ratio, low, high, fifo, channel)
short GT_BufLaserFollowOff(short crd, short fifo, short channel) PUT("GT_BufLaserFollowOff", 3, crd, fifo, channel)
short GT_BufLaserFollowMode(short crd, short source, short fifo, short channel, double power)
    PUT("GT_BufLaserFollowMode", 5, crd, source, fifo, channel, power)
