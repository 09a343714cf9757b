() => [...document.querySelectorAll('figure svg')].filter(svg => {
  const title = document.getElementById(svg.getAttribute('aria-labelledby'));
  return svg.getAttribute('role') !== 'img' || !title || !title.textContent.trim();
}).length
