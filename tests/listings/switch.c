switch (material)                                // error: GJ117
{
case 1: GT_BufLaserPrfCmd(1, 20, 0, 0); break;
default: GT_BufLaserPrfCmd(1, 70, 0, 0);
}
