…… …… …… 

rtn = GT_SetAxisMode(7,1);           // 注意！！在设置为模拟量控制方式时，不要调用该指

令配置 

rtn = GT_LaserPowerMode(2,5,0,0);     // 设置激光能量控制方式为模拟量方式 

                                  // 最大输出电压为 5V 

// 最小输出电压为 0V 

rtn = GT_LaserPrfCmd(2.5,0);         // 设置输出电压为 2.5V 

rtn = GT_SetHSIOOpt(1,0);           // 打开激光开关 

…… …… …… 
