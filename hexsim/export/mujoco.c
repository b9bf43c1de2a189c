/* MuJoCo's functions. On Windows from mujoco.dll beside this library: by its full path it is a library of its own, though
   the tool may have another MuJoCo, and the tool need not look for it. */
#ifdef _WIN32
#define WIN32_LEAN_AND_MEAN
#define NOGDI
#include <windows.h>
#endif

#include "plant.h"

#ifdef _WIN32
Mujoco mj;

bool find_mujoco(void) {
  static wchar_t path[32768];
  HMODULE own = NULL, library;
  if (mj.act_bias) return true; /* the last one to be filled in */
  if (!GetModuleHandleExW(GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS | GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT,
                          (LPCWSTR)&mj, &own))
    return false;
  DWORD end = GetModuleFileNameW(own, path, 32768 - sizeof "mujoco.dll");
  while (end > 0 && path[end - 1] != L'\\' && path[end - 1] != L'/') end--;
  for (const char *sign = "mujoco.dll"; (path[end++] = *sign); sign++);
  library = LoadLibraryExW(path, NULL, LOAD_WITH_ALTERED_SEARCH_PATH);
  if (!library) return false;
#define X(name) \
  if (!(mj.name = (void *)GetProcAddress(library, "mj_" #name))) return false;
  MUJOCO_FUNCTIONS(X)
#undef X
#define X(name) \
  if (!(mj.name = (void *)GetProcAddress(library, "mjcb_" #name))) return false;
  CALLBACKS(X)
#undef X
  return true;
}
#else
Mujoco mj = {
#define X(name) .name = mj_##name,
    MUJOCO_FUNCTIONS(X)
#undef X
#define X(name) .name = &mjcb_##name,
    CALLBACKS(X)
#undef X
};

bool find_mujoco(void) { return true; }
#endif
