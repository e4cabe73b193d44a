/* A stand-in for the vendor's header: the prototypes of the laser manual and of the sister series. */
#ifndef GTS_H
#define GTS_H

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    short dimension;
    short profile[8];
    double synVelMax;
    double synAccMax;
    short evenTime;
    short setOriginFlag;
    long originPos[8];
} TCrdPrm;

short GT_Open(short channel, short param);
short GT_Close(void);
short GT_LoadConfig(char *pFile);
short GT_ClrSts(short axis, short count);
short GT_AxisOn(short axis);
short GT_Reset(void);
short GT_Stop(long mask, long option);

short GT_SetAxisMode(short axis, short mode);
short GT_SetHSIOOpt(unsigned short value, short channel);
short GT_GetHSIOOpt(unsigned short *pValue, short channel);
short GT_LaserPowerMode(short laserPowerMode, double maxValue, double minValue, short channel);
short GT_LaserPrfCmd(double outputCmd, short channel);
short GT_LaserOutFrq(double outFrq, short channel);
short GT_SetPulseWidth(unsigned short width, short channel);
short GT_SetWaitPulse(unsigned short mode, double waitPulseFrq, double waitPulseDuty, short channel);
short GT_SetPreVltg(unsigned short mode, double voltageValue, short channel);
short GT_SetLevelDelay(unsigned short highLevelDelay, unsigned short lowLevelDelay, short channel);
short GT_EnaFPK(unsigned short time1, unsigned short time2, unsigned short laserOffDelay, short channel);
short GT_DisFPK(short channel);
short GT_SetLaserDisMode(short mode, short source, long *pPos, double *pScale, short channel);
short GT_SetLaserDisRatio(double *pRatio, double minPower, double maxPower, short channel);

short GT_SetCrdPrm(short crd, TCrdPrm *pCrdPrm);
short GT_SetCrdStopDec(short crd, double decSmoothStop, double decAbruptStop);
short GT_CrdClear(short crd, short fifo);
short GT_CrdSpace(short crd, long *pSpace, short fifo);
short GT_CrdStart(short mask, short option);
short GT_CrdStatus(short crd, short *pRun, long *pSegment, short fifo);
short GT_GetCrdPos(short crd, double *pPos);

short GT_LnXY(short crd, long x, long y, double synVel, double synAcc, double velEnd, short fifo);
short GT_LnXYG0(short crd, long x, long y, double synVel, double synAcc, short fifo);
short GT_ArcXYC(short crd, long x, long y, double xCenter, double yCenter, short circleDir, double synVel,
                double synAcc, double velEnd, short fifo);
short GT_ArcXYR(short crd, long x, long y, double radius, short circleDir, double synVel, double synAcc,
                double velEnd, short fifo);
short GT_BufDelay(short crd, unsigned short delayTime, short fifo);
short GT_BufLaserOn(short crd, short fifo, short channel);
short GT_BufLaserOff(short crd, short fifo, short channel);
short GT_BufLaserPrfCmd(short crd, double laserPower, short fifo, short channel);
short GT_BufLaserPrfFollow(short crd, double ratio, long minPower, long maxPower, short fifo, short channel);
short GT_BufLaserFollowRatio(short crd, double ratio, double minPower, double maxPower, short fifo, short channel);
short GT_BufLaserFollowOff(short crd, short fifo, short channel);
short GT_BufLaserFollowMode(short crd, short source, short fifo, short channel, double startPower);

#ifdef __cplusplus
}
#endif
#endif
