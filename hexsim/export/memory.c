/* Arrays of the compiled equations, as numba's runtime lays them out: a head that counts its owners, and the numbers. */
#include <stdint.h>
#include <stdlib.h>

typedef struct {
  size_t owners;
  void *destroy, *about, *data;
  size_t size;
  void *allocator;
} Head;

void *NRT_MemInfo_alloc_aligned(size_t size, uint32_t alignment) {
  Head *head = malloc(sizeof *head + size + alignment);
  if (!head) abort();
  *head = (Head){.owners = 1, .size = size};
  head->data = (void *)(((uintptr_t)(head + 1) + alignment - 1) / alignment * alignment);
  return head;
}
void *NRT_MemInfo_alloc_safe_aligned(size_t size, uint32_t alignment) { return NRT_MemInfo_alloc_aligned(size, alignment); }
void *NRT_MemInfo_alloc(size_t size) { return NRT_MemInfo_alloc_aligned(size, 32); }
void NRT_MemInfo_call_dtor(Head *head) { free(head); }
void *NRT_MemInfo_data_fast(Head *head) { return head->data; }
void *NRT_Allocate(size_t size) { return malloc(size); }
void NRT_Free(void *block) { free(block); }

/* Strides of an array without gaps in another shape; 0: it has gaps. */
int numba_attempt_nocopy_reshape(intptr_t n, const intptr_t *shape, const intptr_t *strides, intptr_t new_n,
                                 const intptr_t *new_shape, intptr_t *new_strides, intptr_t item, int is_f_order) {
  intptr_t width = item;
  for (intptr_t k = n - 1; k >= 0; width *= shape[k--])
    if (shape[k] != 1 && strides[k] != width) return 0;
  width = item;
  for (intptr_t k = new_n - 1; k >= 0; width *= new_shape[k--]) new_strides[k] = width;
  return !is_f_order;
}
