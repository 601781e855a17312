/* What every Cortex-M has alike: reset, vectors, interrupt controller, SysTick. Arm DDI 0403, ARMv7-M. */
#ifndef CORTEX_M_H
#define CORTEX_M_H

#include <stdint.h>

typedef void (*cortex_handler)(void);

#define NVIC_ENABLE ((volatile uint32_t *)0xE000E100U)
#define NVIC_CLEAR_PENDING ((volatile uint32_t *)0xE000E280U)
#define NVIC_PRIORITY ((volatile uint8_t *)0xE000E400U)
#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010U)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014U)
#define SYSTICK_VALUE (*(volatile uint32_t *)0xE000E018U)
#define SYSTEM_PRIORITY ((volatile uint8_t *)0xE000ED18U) /* of exceptions 4 ... 15 */

#define SYSTICK_RUN_WITH_INTERRUPT 0x7U /* at the processor's clock */

/* The board's first function. */
void reset(void);

/* Named by the linker script. */
extern uint32_t linker_stack_top, linker_data_start, linker_data_end, linker_data_load, linker_bss_start, linker_bss_end;

static inline uint32_t cortex_interrupts_off(void)
{
    uint32_t before;

    __asm volatile("mrs %0, primask\n cpsid i" : "=r"(before) : : "memory");
    return before;
}

static inline void cortex_interrupts_restore(uint32_t before)
{
    __asm volatile("msr primask, %0" : : "r"(before) : "memory");
}

static inline void cortex_wait(void)
{
    __asm volatile("wfi" : : : "memory");
}

static inline void nvic_enable(uint32_t number, uint8_t priority)
{
    NVIC_PRIORITY[number] = priority;
    NVIC_ENABLE[number / 32U] = (uint32_t)1U << (number % 32U);
}

static inline void nvic_clear_pending(uint32_t number)
{
    NVIC_CLEAR_PENDING[number / 32U] = (uint32_t)1U << (number % 32U);
}

static inline void systick_start(uint32_t cycles, uint8_t priority)
{
    SYSTEM_PRIORITY[15 - 4] = priority;
    SYSTICK_RELOAD = cycles - 1U;
    SYSTICK_VALUE = 0U;
    SYSTICK_CONTROL = SYSTICK_RUN_WITH_INTERRUPT;
}

/* Initialised data and zeros. */
static inline void cortex_begin_memory(void)
{
    const uint32_t *from = &linker_data_load;

    for (uint32_t *to = &linker_data_start; to < &linker_data_end; to++) {
        *to = *from;
        from++;
    }
    for (uint32_t *to = &linker_bss_start; to < &linker_bss_end; to++) {
        *to = 0U;
    }
}

/* A fault of the processor starts it anew; reset switches the output off by hardware, and core_begin before all else. */
static inline void cortex_fault(void)
{
    *(volatile uint32_t *)0xE000ED0CU = 0x05FA0004U; /* AIRCR: system reset */
    for (;;) {
    }
}

struct cortex_vectors {
    const void *stack_top;
    cortex_handler system[15];
};

/* The table of vectors: reset and SysTick handlers, then the device's interrupts as designated initialisers. */
#define CORTEX_VECTORS(count, reset, tick, ...)                                                                       \
    __attribute__((section(".vectors"), used)) static const struct {                                                  \
        struct cortex_vectors core;                                                                                    \
        cortex_handler device[count];                                                                                  \
    } vectors = {{&linker_stack_top,                                                                                   \
                  {reset, cortex_fault, cortex_fault, cortex_fault, cortex_fault, cortex_fault, 0, 0, 0, 0, cortex_fault, \
                   cortex_fault, 0, cortex_fault, tick}},                                                              \
                 {__VA_ARGS__}};

#endif
