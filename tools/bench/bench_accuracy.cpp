#include "accuracy_run.hpp"
int main() { return 0; }
