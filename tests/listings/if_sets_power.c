double watts = 60;
if (foil) watts = 15;                            // error: GJ117
GT_BufLaserPrfCmd(1, watts, 0, 0);
