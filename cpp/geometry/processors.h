// Functions in several versions, for processors with and without vector instructions.
#pragma once

/// Before a function: compile a second version of it, and of what is inlined into it, for
/// processors with AVX2 and FMA. The processor decides at run time. Sums of doubles take half the
/// time.
#if defined(__x86_64__) && defined(__gnu_linux__)
#define QSDOLFINX_FOR_PROCESSORS __attribute__((target_clones("default", "arch=x86-64-v3")))
#else
#define QSDOLFINX_FOR_PROCESSORS
#endif
