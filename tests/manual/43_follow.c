…… …… …… 

rtn = GT_SetAxisMode(7,1);                   // 配置第一路激光通道 

rtn = GT_LaserPowerMode(0,100,0,0);           // 设置激光能量控制方式为占空比模式 

                                           // 最大占空比为 100%，最小占空比为 0% 

rtn = GT_LaserOutFrq(10,0);                   // 设置 PWM 输出的频率为：10KHz 

…… …… ……            // 建立插补坐标系 1 

rtn = GT_CrdClear(1,0);                      // 清除坐标系 1 的 FIFO0 中的数据 

 

rtn = GT_BufLaserPrfFollow(1,0.1,10,100,0,0);   // 设置跟随的比率为 0.1 

                                          最小能量为 10% 

                                          最大能量为 100% 

rtn = GT_BufLaserOn(1,0,0); 

rtn = GT_LnXY(1,100000,0,50,2,0,0);  // 运动过程中根据坐标系的规划合成速度进行激光能量

的调整 

rtn = GT_LnXY(1,0,10000,50,2,0,0);      

…… …… …… 

rtn = GT_BufLaserOff(1,0,00);  // 关闭激光通道 1 的输出 

rtn = GT_CrdStart(1,0);            // 启动坐标系 1 的 FIFO0 的插补运动 

…… …… …… 
