…… …… …… 

rtn = GT_SetAxisMode(7,1);                  // 配置第一路激光通道 

rtn = GT_LaserPowerMode(0,100,10,0);        // 设置激光能量控制方式为占空比模式 

                                        // 最大占空比为 100%，最小占空比为 10% 

rtn = GT_LaserOutFrq(10,0);                // 设置 PWM 输出的频率为: 10KHz 

rtn = GT_LaserPrfCmd(25,0);               // 设置占空比为 25% 

rtn = GT_SetHSIOOpt(1,0);                // 打开激光开关 

…… …… …… 
