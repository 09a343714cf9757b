() => [...document.querySelectorAll('.scroll, .picture')]
  .filter(box => box.scrollWidth > box.clientWidth + 1)
  .map(box => box.getAttribute('aria-label') || box.textContent.slice(0, 60))
