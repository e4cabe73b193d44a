GT_LnXY(1, 100, 0, 50, 2, 0, 0); // goes on
if the laser is ready            // error: GJ117
GT_LnXY(1, 200, 0, 50, 2, 0, 0); // goes on
x = 5 is the start;              // error: GJ111
GT_LnXY(1, 300, 0, 50, 2, 0, 0); // goes on
with GT_LnXY again               // error: GJ111
