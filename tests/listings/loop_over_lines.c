int row;
for (row = 0; row < 5; row++)                    // error: GJ117
{
    GT_LnXY(1, 8000, row * 200, 50, 2, 0, 0);
    GT_LnXY(1, 0, row * 200, 50, 2, 0, 0);
}
