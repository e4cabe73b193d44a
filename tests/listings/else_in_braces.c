GT_BufLaserOn(1, 0, 0);
if (passes > 1)                                  // error: GJ117
{
    GT_BufLaserPrfCmd(1, 80, 0, 0);
}
else
{
    GT_BufLaserPrfCmd(1, 35, 0, 0);
}
GT_LnXY(1, 7000, 7000, 60, 2, 0, 0);
