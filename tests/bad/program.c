int main(void) // error: GJ119
{
    GT_CrdClear(1, 0);
    for (int i = 0; i < 5; i++)
        GT_BufDelay(1, 10, 0);
    GT_CrdStart(1, 0);
    return 0;
}
