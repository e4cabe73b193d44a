#ifdef WITH_FRAME                                // error: GJ117
GT_LnXY(1, 0, 30000, 50, 2, 0, 0);
#endif
#if 0                                            // error: GJ117
GT_LnXY(1, 0, 0, 50, 2, 0, 0);
#endif
