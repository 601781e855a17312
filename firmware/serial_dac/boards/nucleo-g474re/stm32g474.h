/* The registers that board.c uses, after ST RM0440, "STM32G4 series reference manual". Own work, under the project's licence. */
#ifndef STM32G474_H
#define STM32G474_H

#include <stdint.h>

#define REGISTER(base, offset) (*(volatile uint32_t *)((base) + (offset)))

#define RCC 0x40021000U
#define RCC_CR REGISTER(RCC, 0x00U)
#define RCC_CFGR REGISTER(RCC, 0x08U)
#define RCC_PLLCFGR REGISTER(RCC, 0x0CU)
#define RCC_AHB2ENR REGISTER(RCC, 0x4CU)
#define RCC_APB1ENR1 REGISTER(RCC, 0x58U)
#define RCC_APB2ENR REGISTER(RCC, 0x60U)
#define FLASH_ACR REGISTER(0x40022000U, 0x00U)

struct gpio {
    volatile uint32_t mode, type, speed, pull, in, out, set_reset, lock, function[2];
};
#define GPIOA ((struct gpio *)0x48000000U)
#define GPIOB ((struct gpio *)0x48000400U)
#define GPIOC ((struct gpio *)0x48000800U)

struct timer {
    volatile uint32_t cr1, cr2, smcr, dier, sr, egr, ccmr1, ccmr2, ccer, cnt, psc, arr;
};
#define TIM2 ((struct timer *)0x40000000U)
#define TIM5 ((struct timer *)0x40000C00U)
#define TIM6 ((struct timer *)0x40001000U)

struct usart {
    volatile uint32_t cr1, cr2, cr3, brr, gtpr, rtor, rqr, isr, icr, rdr, tdr;
};
#define USART2 ((struct usart *)0x40004400U)

#define SPI1_CR1 REGISTER(0x40013000U, 0x00U)
#define SPI1_CR2 REGISTER(0x40013000U, 0x04U)
#define SPI1_SR REGISTER(0x40013000U, 0x08U)
#define SPI1_DR (*(volatile uint8_t *)0x4001300CU) /* as bytes */

#define IWDG_KR REGISTER(0x40003000U, 0x00U)
#define IWDG_PR REGISTER(0x40003000U, 0x04U)
#define IWDG_RLR REGISTER(0x40003000U, 0x08U)

enum { IRQ_USART2 = 38, IRQ_TIM6 = 54, INTERRUPTS = 102 };

#endif
