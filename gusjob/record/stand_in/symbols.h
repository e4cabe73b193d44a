/*
 * The vendor's symbols that have a model. VC_ABI: 0 GUS, 1 GTS (single card), 2 GTS (multi card: a leading cardNum).
 * VC_NO_FOLLOW leaves the velocity follow call out.
 */
#ifndef SYMBOLS_H
#define SYMBOLS_H

#include "calls.h"

#ifndef VC_ABI
#define VC_ABI 0
#endif

/* long of the vendor's header, as the program declares it: some declare int on systems where long has 64 bits. */
#if !defined VC_LONG
typedef long Long;
typedef unsigned long ULong;
#elif VC_LONG == 32
typedef int Long;
typedef unsigned int ULong;
#else
typedef long long Long;
typedef unsigned long long ULong;
#endif

typedef struct {
    short dimension;
    short profile[8];
    double synVelMax;
    double synAccMax;
    short evenTime;
    short setOriginFlag;
    Long originPos[8];
} TCrdPrm;

#if VC_ABI == 2
#define CARD short cardNum,
#define CARD_ALONE short cardNum
#define CARD_NUMBER cardNum
#else
#define CARD
#define CARD_ALONE void
#ifdef CARD_OF_CALL
#define CARD_NUMBER CARD_OF_CALL
#else
#define CARD_NUMBER 0
#endif
#endif

API GT_Open(CARD short channel, short param) CALL("GT_Open", "#,#", open_card, channel, param)
API GT_Close(CARD_ALONE) CALL("GT_Close", "", close_card, 0)
API GT_Reset(CARD_ALONE) CALL("GT_Reset", "", reset, 0)
API GT_ClrSts(CARD short axis, short count) CALL("GT_ClrSts", "#,#", clear_status, axis, count)
API GT_AxisOn(CARD short axis) CALL("GT_AxisOn", "#", switch_axis, axis, 1)
API GT_AxisOff(CARD short axis) CALL("GT_AxisOff", "#", switch_axis, axis, 0)
API GT_Stop(CARD Long mask, Long option) CALL("GT_Stop", "#,#", stop, (double)mask, (double)option)

API GT_LoadConfig(CARD char *pFile)
{
    double a[] = {pFile != NULL};
    return call_with_text(CARD_NUMBER, "GT_LoadConfig", pFile, needs_pointer, a);
}

API GT_GetVersion(CARD char **pVersion)
{
    static char version[] = "virtual controller 1";
    double a[] = {pVersion != NULL};
    short code;
    code = call(CARD_NUMBER, "GT_GetVersion", "version", needs_pointer, a, NULL);
    if (code == DONE)
        *pVersion = version;
    return code;
}

API GT_GetDi(CARD short diType, Long *pValue)
{
    double a[] = {diType, pValue != NULL}, out[1];
    short code;
    code = call(CARD_NUMBER, "GT_GetDi", "#,@value", get_di, a, out);
    if (code == DONE)
        *pValue = (Long)out[0];
    return code;
}

API GT_SetAxisMode(CARD short axis, short mode) CALL("GT_SetAxisMode", "#,#", set_axis_mode, axis, mode)
API GT_SetHSIOOpt(CARD unsigned short value, short channel) CALL("GT_SetHSIOOpt", "#,#", set_switch, value, channel)

API GT_GetHSIOOpt(CARD unsigned short *pValue, short channel)
{
    double a[] = {channel, pValue != NULL}, out[1];
    short code;
    code = call(CARD_NUMBER, "GT_GetHSIOOpt", "@value,#", get_switch, a, out);
    if (code == DONE)
        *pValue = (unsigned short)out[0];
    return code;
}

#if VC_ABI == 0
API GT_LaserPowerMode(short mode, double maxValue, double minValue, short channel)
    CALL("GT_LaserPowerMode", "#,#,#,#", set_power_mode, mode, maxValue, minValue, channel, 0)
API GT_SetPulseWidth(unsigned short width, short channel)
    CALL("GT_SetPulseWidth", "#,#", set_pulse_width, width, channel)
#else
API GT_LaserPowerMode(CARD short mode, double maxValue, double minValue, short channel, short delaymode)
    CALL("GT_LaserPowerMode", "#,#,#,#,#", set_power_mode, mode, maxValue, minValue, channel, delaymode)
API GT_SetPulseWidth(CARD ULong width, short channel)
    CALL("GT_SetPulseWidth", "#,#", set_pulse_width, (double)width, channel)
#endif

API GT_LaserPrfCmd(CARD double outputCmd, short channel)
    CALL("GT_LaserPrfCmd", "#,#", set_power_now, outputCmd, channel)
API GT_LaserOutFrq(CARD double outFrq, short channel) CALL("GT_LaserOutFrq", "#,#", set_carrier, outFrq, channel)
API GT_SetWaitPulse(CARD unsigned short mode, double waitPulseFrq, double waitPulseDuty, short channel)
    CALL("GT_SetWaitPulse", "#,#,#,#", set_standby, mode, waitPulseFrq, waitPulseDuty, channel)
API GT_SetPreVltg(CARD unsigned short mode, double voltageValue, short channel)
    CALL("GT_SetPreVltg", "#,#,#", set_prevoltage, mode, voltageValue, channel)
API GT_SetLevelDelay(CARD unsigned short highLevelDelay, unsigned short lowLevelDelay, short channel)
    CALL("GT_SetLevelDelay", "#,#,#", set_delays, highLevelDelay, lowLevelDelay, channel)
API GT_EnaFPK(CARD unsigned short time1, unsigned short time2, unsigned short laserOffDelay, short channel)
    CALL("GT_EnaFPK", "#,#,#,#", enable_fpk, time1, time2, laserOffDelay, channel)
API GT_DisFPK(CARD short channel) CALL("GT_DisFPK", "#", disable_fpk, channel)

API GT_SetLaserDisMode(CARD short mode, short source, Long *pPos, double *pScale, short channel)
{
    double a[12] = {mode, source};
    int i;
    for (i = 0; i < 4 && pPos && pScale; i++) {
        a[2 + i] = (double)pPos[i];
        a[6 + i] = pScale[i];
    }
    a[10] = channel;
    a[11] = pPos && pScale;
    return call(CARD_NUMBER, "GT_SetLaserDisMode", "#,#,{#,#,#,#},{#,#,#,#},#", set_distance_mode, a, NULL);
}

API GT_SetLaserDisRatio(CARD double *pRatio, double minPower, double maxPower, short channel)
{
    double a[8] = {0};
    if (pRatio)
        memcpy(a, pRatio, 4 * sizeof *a);
    a[4] = minPower;
    a[5] = maxPower;
    a[6] = channel;
    a[7] = pRatio != NULL;
    return call(CARD_NUMBER, "GT_SetLaserDisRatio", "{#,#,#,#},#,#,#", set_distance_ratio, a, NULL);
}

API GT_SetCrdPrm(CARD short crd, TCrdPrm *pCrdPrm)
{
    double a[23] = {crd};
    int i;
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
    return call(CARD_NUMBER, "GT_SetCrdPrm", "#,{#,{#,#,#,#,#,#,#,#},#,#,#,#,{#,#,#,#,#,#,#,#}}", set_crd, a, NULL);
}

API GT_SetCrdStopDec(CARD short crd, double decSmoothStop, double decAbruptStop)
    CALL("GT_SetCrdStopDec", "#,#,#", set_stop_dec, crd, decSmoothStop, decAbruptStop)

API GT_CrdClear(CARD short crd, short fifo) CALL("GT_CrdClear", "#,#", clear, crd, fifo)

API GT_CrdSpace(CARD short crd, Long *pSpace, short fifo)
{
    double a[] = {crd, fifo, pSpace != NULL}, out[1];
    short code;
    code = call(CARD_NUMBER, "GT_CrdSpace", "#,~space,#", space, a, out);
    if (code == DONE)
        *pSpace = (Long)out[0];
    return code;
}

API GT_CrdStart(CARD short mask, short option) CALL("GT_CrdStart", "#,#", start, mask, option)

API GT_CrdStatus(CARD short crd, short *pRun, Long *pSegment, short fifo)
{
    double a[] = {crd, fifo, pRun && pSegment}, out[2];
    short code;
    code = call(CARD_NUMBER, "GT_CrdStatus", "#,@run,~segment,#", status, a, out);
    if (code == DONE) {
        *pRun = (short)out[0];
        *pSegment = (Long)out[1];
    }
    return code;
}

API GT_GetCrdPos(CARD short crd, double *pPos)
{
    double a[] = {crd, pPos != NULL}, out[5];
    char form[] = "#,~2position";
    short code;
    form[3] = (char)('0' + position_count(CARD_NUMBER, crd));
    code = call(CARD_NUMBER, "GT_GetCrdPos", form, position, a, out);
    if (code == DONE)
        memcpy(pPos, out, (size_t)(form[3] - '0') * sizeof *out);
    return code;
}

API GT_GetCrdVel(CARD short crd, double *pSynVel)
{
    double a[] = {crd, pSynVel != NULL}, out[1];
    short code;
    code = call(CARD_NUMBER, "GT_GetCrdVel", "#,~velocity", velocity, a, out);
    if (code == DONE)
        *pSynVel = out[0];
    return code;
}

API GT_LnXY(CARD short crd, Long x, Long y, double synVel, double synAcc, double velEnd, short fifo)
    CALL("GT_LnXY", "#,#,#,#,#,#,#", put_line, crd, (double)x, (double)y, synVel, synAcc, velEnd, fifo)
API GT_ArcXYC(CARD short crd, Long x, Long y, double xCenter, double yCenter, short circleDir, double synVel,
                double synAcc, double velEnd, short fifo)
    CALL("GT_ArcXYC", "#,#,#,#,#,#,#,#,#,#", put_arc_by_centre, crd, (double)x, (double)y, xCenter, yCenter, circleDir,
         synVel, synAcc, velEnd, fifo)
API GT_ArcXYR(CARD short crd, Long x, Long y, double radius, short circleDir, double synVel, double synAcc,
                double velEnd, short fifo)
    CALL("GT_ArcXYR", "#,#,#,#,#,#,#,#,#", put_arc_by_radius, crd, (double)x, (double)y, radius, circleDir, synVel,
         synAcc, velEnd, fifo)
API GT_BufDelay(CARD short crd, unsigned short delayTime, short fifo)
    CALL("GT_BufDelay", "#,#,#", put_delay, crd, delayTime, fifo)
API GT_BufLaserOn(CARD short crd, short fifo, short channel)
    CALL("GT_BufLaserOn", "#,#,#", put_switch, crd, fifo, channel, 1)
API GT_BufLaserOff(CARD short crd, short fifo, short channel)
    CALL("GT_BufLaserOff", "#,#,#", put_switch, crd, fifo, channel, 0)
API GT_BufLaserPrfCmd(CARD short crd, double laserPower, short fifo, short channel)
    CALL("GT_BufLaserPrfCmd", "#,#,#,#", put_power, crd, laserPower, fifo, channel)

#ifndef VC_NO_FOLLOW
#if VC_ABI == 0
API GT_BufLaserPrfFollow(short crd, double ratio, Long minPower, Long maxPower, short fifo, short channel)
    CALL("GT_BufLaserPrfFollow", "#,#,#,#,#,#", put_follow, crd, ratio, (double)minPower, (double)maxPower, fifo,
         channel)
#else
API GT_BufLaserFollowRatio(CARD short crd, double ratio, double minPower, double maxPower, short fifo, short channel)
    CALL("GT_BufLaserFollowRatio", "#,#,#,#,#,#", put_follow, crd, ratio, minPower, maxPower, fifo, channel)
#endif
#endif

#endif
